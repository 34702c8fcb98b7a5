"""Predict a recorded flight by simulating it."""
