"""The tube about the planned path, and the corridor that it must stay in."""
