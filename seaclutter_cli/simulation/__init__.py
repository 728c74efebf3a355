"""A lidar at sea: labelled recordings of scenes."""
