"""The probability of rare events: subset simulation over the noise and the start of flights."""
