"""The halves by the clock."""
