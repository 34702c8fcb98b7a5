"""Goals in flight: asked for over the wire, planned beside it, flown to."""
