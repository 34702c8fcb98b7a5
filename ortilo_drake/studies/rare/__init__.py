"""How often what hardly ever happens does: multilevel splitting over the noise of flights."""
