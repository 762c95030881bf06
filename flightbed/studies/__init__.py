"""Reproductions of published studies and the comparison of estimators; each has a function that returns a ``base.Study``."""
