"""Logs of flights as rosbag2 folders of MCAP: written while flying, read back without loss, replayed."""
