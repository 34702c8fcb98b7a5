"""Measurement handler and intermittent Kalman filter."""
