"""What goes wrong in the world in the middle of a flight: the faults of scenario/faults.py applied."""
