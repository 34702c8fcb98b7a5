"""ROS 2 messages of a flight, and the bridge that publishes them."""
