"""What a lossy, late command link does to the loop."""
