"""Landmark detection in pictures: networks and their boxes."""
