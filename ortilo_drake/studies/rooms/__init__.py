"""Users' rooms: checks of the file, coverage by sensors, and the places where the position is lost."""
