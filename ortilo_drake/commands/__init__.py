"""The commands of `ortilo`, one module each; Drake is imported only after the arguments are checked."""
