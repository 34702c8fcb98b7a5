"""The room that the cameras render and Meshcat shows."""
