"""Processes that fly: workers of this machine, and those of a scheduler."""
