"""Reconstruction of unknown inputs: the acting elevator deflection, or a gust; K by regression on the measured deflection."""
