"""Judging of the detector: average precision on pictures that it was not trained with."""
