"""Own ship's structure in the view of the lidar: its mask, and the search for it."""
