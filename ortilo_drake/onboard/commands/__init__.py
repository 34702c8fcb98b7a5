"""The commands on their way to the rotors: which acted, which will, and what that makes of the state."""
