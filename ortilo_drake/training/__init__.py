"""Making of the shipped detector: auto-labelled renders, training, evaluation, export, calibration."""
