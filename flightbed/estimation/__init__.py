"""Estimators of effectiveness and state, one algorithm a file."""
