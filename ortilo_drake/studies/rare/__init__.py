"""The probability of rare events, by subset simulation over the noise and the start of flights."""
