"""Pictures with boxes to learn from: random rooms, appearance, labels, sets."""
