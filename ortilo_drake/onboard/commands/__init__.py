"""The commands on their way to the rotors: those that acted, those that will act, and the state predicted from them."""
