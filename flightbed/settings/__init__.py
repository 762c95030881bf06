"""The tables and keys of scenarios and campaigns."""
