"""Fit the errors of simulated sensors to recordings with a truth."""
