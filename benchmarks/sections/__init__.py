"""Sections of speed.py, one per file: ``measure(effort)`` returns its tables."""
