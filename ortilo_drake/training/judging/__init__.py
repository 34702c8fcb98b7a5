"""Judging of the detector: average precision on pictures it never saw."""
