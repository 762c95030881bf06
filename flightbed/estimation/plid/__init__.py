"""Pseudo-linear identification (Kemp 1987) of the pitch dynamics, and K from it."""
