"""Noise found from flights by maximum likelihood, and the filter tuned to it."""
