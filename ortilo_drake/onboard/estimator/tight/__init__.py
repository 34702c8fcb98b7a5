"""The tightly coupled estimator: an error-state Kalman filter on single ranges, pixels and inertial samples."""
