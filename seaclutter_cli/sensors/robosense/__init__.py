"""RoboSense sensors: RS-LiDAR-16, RS-LiDAR-32 and RS-Helios."""
