"""Exact intervals, resampled intervals, moments and percentiles of histories."""
