"""Goals that a user sends in flight: asked for over the bus, planned in another process, flown to."""
