"""Self-contained HTML pages: of a flight, and of the studies' results."""
