"""Settings tables, families of kinds, overrides, and code from outside the package. The only package that imports pydantic.

The tables of a scenario and the checks between them are in ``scenario/``.
"""
