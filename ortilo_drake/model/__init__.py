"""What both halves know: names of signals, the vehicle, its equations, the surveyed room."""
