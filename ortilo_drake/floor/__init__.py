"""The Cramer-Rao bound of a flight: the least error that any estimator could have with the messages that arrived."""
