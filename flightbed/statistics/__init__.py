"""Exact and bootstrap intervals, moments, and percentiles of histories. Pure functions of numbers, without flights or files."""
