"""Rooms of a user: is a file right, what can be seen and measured where, and where the position gets lost."""
