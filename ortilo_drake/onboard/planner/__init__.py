"""Paths through the free space of the room."""
