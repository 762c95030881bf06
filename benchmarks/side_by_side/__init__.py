"""All estimators on the same flights: what estimators.py flies, measures and writes into docs/estimators.md."""
