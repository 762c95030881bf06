"""The tables of a scenario, the checks between tables, and reading. General rules for settings tables are in ``config/``."""
