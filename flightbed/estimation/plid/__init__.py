"""Pseudo-linear identification of the pitch dynamics, and K from it."""
