"""The commands `ortilo room`, one module each."""
