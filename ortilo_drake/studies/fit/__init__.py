"""What recordings with a truth tell a simulation of its sensors' errors."""
