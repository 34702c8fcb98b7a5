"""The model that both halves share: signal names, the vehicle and its equations, the surveyed room."""
