"""The position fix from ranges to the anchors."""
