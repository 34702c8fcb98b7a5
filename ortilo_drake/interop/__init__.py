"""Other people's formats: logs, ROS 2, MAVLink."""
