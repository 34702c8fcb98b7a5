"""The best possible estimates of a flight: each by all measurements, later ones included."""
