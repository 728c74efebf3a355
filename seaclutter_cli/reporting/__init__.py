"""A report: what a filter did to every frame in numbers, and some frames to look at, as one page that opens offline."""
