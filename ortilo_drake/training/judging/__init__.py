"""Evaluation of the detector: average precision on pictures that were not used in training."""
