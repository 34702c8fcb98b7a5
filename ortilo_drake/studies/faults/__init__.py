"""What a fault in flight does to each estimator, and how long it takes to be over it."""
