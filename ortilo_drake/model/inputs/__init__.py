"""Users' input: its defaults, and the lines that say what is wrong with it."""
