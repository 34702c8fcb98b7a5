"""The onboard half: perception, estimation, control and planning. It imports nothing from the world half."""
