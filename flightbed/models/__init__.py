"""Trim, linear models, their modes and validity, and tables of an aircraft."""
