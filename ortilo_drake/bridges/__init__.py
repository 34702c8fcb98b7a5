"""The onboard estimate in the languages of other autopilots and tools."""
