"""Maps: thousands of flights at each point of a design over a scenario's settings."""
