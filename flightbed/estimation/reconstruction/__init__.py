"""Reconstruction of unknown inputs: the acting elevator deflection, or a gust."""
