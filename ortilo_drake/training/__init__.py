"""How the shipped detector is made: auto-labelled renders, training, evaluation, export, calibration."""
