"""ROS 2 bags: recording folders (`folder`) and sqlite3 storage files (`db3.Db3Source`)."""
