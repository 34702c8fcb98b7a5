"""The onboard half: perception, estimation, control and planning. It imports nothing of the world."""
