"""`ortilo analyze`: the studies of one scenario as one report."""
