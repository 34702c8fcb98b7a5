"""The sensors, each described once: its message, its link, its fix, and what it tells the filter."""
