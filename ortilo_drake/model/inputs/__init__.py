"""What users write: what is wrong with it, and what they may leave out."""
