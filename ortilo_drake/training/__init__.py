"""How the shipped detector came about: auto-labelled renders, training, evaluation, export, calibration."""
