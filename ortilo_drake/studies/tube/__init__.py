"""The tube about the planned path, and the corridor in which the tube must stay."""
