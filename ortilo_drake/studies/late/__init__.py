"""What late measurements cost, and what replaying them saves."""
