"""Gupta, D'Amato, Ali and Bernstein (2012), recomputed: reconstruction of an unknown harmonic input."""
