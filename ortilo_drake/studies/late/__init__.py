"""The cost of late measurements, and the gain from replaying them."""
