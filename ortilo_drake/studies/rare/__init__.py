"""How often what hardly ever happens does: subset simulation over the noise and the start of flights."""
