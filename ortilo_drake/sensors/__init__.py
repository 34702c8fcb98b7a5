"""The sensors, each described once: the message, the link, the fix, and the rows that the filter gets."""
