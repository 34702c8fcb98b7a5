"""Training of the detector's network, from augmentation to the exported weights."""
