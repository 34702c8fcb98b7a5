"""LQG control through a link that loses commands, with and without acknowledgement."""
