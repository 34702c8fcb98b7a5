"""Warnings about a scenario before it is flown."""
