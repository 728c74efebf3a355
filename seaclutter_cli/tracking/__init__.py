"""Objects over time: clusters of kept points, tracks with ids, and their boxes and velocities."""
