"""Maximum likelihood estimates of the noise from recorded flights, and the filter tuned to them."""
