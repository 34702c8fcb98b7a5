"""Discrete algebraic Riccati equations: solvers, checks, conditioning."""
