"""Packets on the LCM bus: sealed, checked, put together again."""
