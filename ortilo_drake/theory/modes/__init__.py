"""Modes, controllability and observability of linear systems."""
