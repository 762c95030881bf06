"""Trim, linear models, their modes and validity, and tables of an aircraft. Nothing here runs in flight."""
