"""Intersections of rays with the room's shapes."""
