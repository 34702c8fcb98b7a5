"""A page of Drake's Meshcat that only the user who started it can open and use."""
