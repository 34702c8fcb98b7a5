"""Kalman filtering with intermittent observations: bounds, critical rates, simulation."""
