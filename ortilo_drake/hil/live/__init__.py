"""A flight that goes on while its user changes the world, `ortilo live`."""
