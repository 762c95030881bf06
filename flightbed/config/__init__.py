"""Settings tables, families of kinds, overrides, and code from outside the package. The only package that imports pydantic."""
