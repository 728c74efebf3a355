"""ROS 1 bags, intact or damaged: `source.BagSource`."""
