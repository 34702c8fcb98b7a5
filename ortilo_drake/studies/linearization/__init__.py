"""The linearisation by Drake against the closed forms; observability, gramians."""
