"""HTML reports: statistics of every frame and the points of selected frames, in a single page that works offline."""
