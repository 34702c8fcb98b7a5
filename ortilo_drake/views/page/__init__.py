"""Self-contained HTML pages: of a flight, and of what the studies wrote."""
