"""Both halves in real time: paced by the clock, with their timing."""
