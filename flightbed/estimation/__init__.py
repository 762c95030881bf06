"""Estimators of effectiveness and state, one algorithm per file or folder. They see measurements, never the truth."""
