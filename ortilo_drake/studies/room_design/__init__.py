"""The design of a room's anchors and landmarks, and the survey of those that it has."""
