"""LQG control through a link that loses commands and acknowledges those that arrive."""
