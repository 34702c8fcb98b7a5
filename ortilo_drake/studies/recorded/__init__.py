"""Recorded motions: a filter of single ranges and IMU is calibrated on a first part and judged on the rest."""
