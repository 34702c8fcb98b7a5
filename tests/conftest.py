"""Hypothesis for the whole suite: the same examples in every run, and time for numba to compile.

Profiles that a test file registers itself start from this one, so they keep its settings.
"""

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")
