"""Consistency of the filter's covariance with its errors: NEES, NIS and whiteness over flights."""
