"""Calibration of the projected camera by what the rendered one and its detector do."""
