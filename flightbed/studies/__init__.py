"""Reproductions of published studies: one module or package each, with a function that returns a ``base.Study``."""
