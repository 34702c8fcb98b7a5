"""Calibration of the projected camera, from flights with the rendered camera and its detector."""
