"""A recorded flight flown again in simulation: what a simulation would have said of it."""
