"""The faults of scenario/faults.py, applied in the middle of a flight."""
