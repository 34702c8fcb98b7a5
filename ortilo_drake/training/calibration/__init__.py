"""Calibration of the projected camera from the rendered camera and its detector."""
