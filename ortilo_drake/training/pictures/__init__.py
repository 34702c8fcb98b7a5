"""Labelled training pictures: random rooms, random appearance, labels, and sets of pictures."""
