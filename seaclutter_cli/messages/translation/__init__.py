"""Translation of messages between the serialisations of ROS 1 and ROS 2, with their definitions."""
