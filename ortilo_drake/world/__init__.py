"""Simulated physics: the vehicle, its sensors, the radio link, the visible scene."""
