"""The linear-quadratic servo."""
