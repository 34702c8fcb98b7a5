"""How good the detector is: average precision, judged on pictures it never saw."""
