"""RoboSense: RS-LiDAR-16, RS-LiDAR-32, RS-Helios."""
