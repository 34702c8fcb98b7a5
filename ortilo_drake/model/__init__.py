"""The model that both halves share: names of signals, the vehicle, its equations, the surveyed room."""
