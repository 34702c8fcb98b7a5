"""The position from detected landmarks."""
