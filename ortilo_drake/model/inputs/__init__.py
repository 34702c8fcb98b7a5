"""Users' input: its defaults, and the messages for what is wrong in it."""
