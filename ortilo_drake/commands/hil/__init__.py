"""The commands `ortilo hil`, one module each."""
