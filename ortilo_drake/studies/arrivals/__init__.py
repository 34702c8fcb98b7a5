"""How many measurements are enough: the filter's covariance over arrival rates and bursts."""
