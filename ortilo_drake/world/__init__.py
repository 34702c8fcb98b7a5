"""Simulated physics: the vehicle, its sensors, the radio link, what the eye sees."""
