"""The commands of `ortilo`, one module each; Drake is imported only once the arguments are known to be right."""
