"""Recorded motions: a filter on single ranges and IMU, calibrated on a first part, judged on the rest."""
