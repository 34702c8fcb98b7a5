"""The study of faults in flight: their effect on each estimator, and the time that it takes to recover."""
