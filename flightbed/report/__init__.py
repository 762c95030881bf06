"""Figures and pages of one flight."""
