"""Predict a recorded flight by simulations of it."""
