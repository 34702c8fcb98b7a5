"""The filter's covariance over arrival rates and bursts: how many measurements are enough."""
