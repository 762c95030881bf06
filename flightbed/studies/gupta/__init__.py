"""Gupta, D'Amato, Ali and Bernstein (2012): reconstruction of an unknown harmonic input, recomputed."""
