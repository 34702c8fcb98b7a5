"""Theory on matrices taken from the diagram that flies: linearisation, Riccati equations, loss, delay, honesty."""
