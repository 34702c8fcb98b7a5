"""Margins and frequency responses of loops."""
