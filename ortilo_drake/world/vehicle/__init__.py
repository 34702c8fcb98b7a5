"""The vehicle's physics: plant, rotors, disturbance, failsafe."""
