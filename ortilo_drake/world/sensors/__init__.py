"""The sensors: from the true state to a stamped message."""
