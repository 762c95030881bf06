"""The pilot's commands: one input shape per file."""
