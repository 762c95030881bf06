"""The tables of a scenario, the checks between tables, and reading."""
