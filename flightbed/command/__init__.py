"""Commands: what the pilot asks for."""
