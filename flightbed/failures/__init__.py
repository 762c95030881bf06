"""Failures as functions of the tick."""
