"""Hardware in the loop: the world and the onboard half in two processes, with ZeroMQ between them."""
