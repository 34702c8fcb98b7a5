"""Theorems on matrices; nothing here knows a scenario."""
