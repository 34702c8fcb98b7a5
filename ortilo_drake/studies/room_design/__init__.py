"""Which anchors and landmarks a room should have, and where those that it has stand."""
