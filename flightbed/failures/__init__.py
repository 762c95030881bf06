"""Failures, as functions."""
