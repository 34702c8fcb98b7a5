"""Packets between the halves: LCM messages over ZeroMQ, checked and put together again."""
