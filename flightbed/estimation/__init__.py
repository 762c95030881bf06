"""Estimators of effectiveness and state, one algorithm per file."""
