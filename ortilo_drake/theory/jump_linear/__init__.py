"""Jump-linear systems: mean-square stability and second moments."""
