"""Labelled training pictures: random rooms, appearance, labels, sets."""
