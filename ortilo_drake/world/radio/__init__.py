"""The radio links of sensors, pictures and commands: rate, loss, blackouts, delay."""
