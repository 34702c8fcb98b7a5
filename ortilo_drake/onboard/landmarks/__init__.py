"""The position fix from detected landmarks."""
