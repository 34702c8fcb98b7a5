"""What flies: perception, estimation, control and planning. Imports nothing of the world."""
