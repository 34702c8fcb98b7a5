"""Real sensors' messages through the filter of `ortilo replay`, while they come."""
