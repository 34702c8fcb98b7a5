"""Whether the filter's covariance is honest: NEES, NIS, whiteness over flights."""
