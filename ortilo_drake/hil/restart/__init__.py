"""Restarts of the onboard half: it is killed, starts again and flies on from a checkpoint."""
