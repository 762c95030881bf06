"""Plants: what flies."""
