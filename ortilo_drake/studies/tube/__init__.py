"""How far the vehicle may leave its path: the tube around it and the corridor."""
