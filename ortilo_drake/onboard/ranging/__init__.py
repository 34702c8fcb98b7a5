"""The position from ranges to the anchors."""
