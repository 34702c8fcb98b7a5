"""A page of Drake's Meshcat that only its own user can open and use."""
