"""What speed.py measures, one section a file: ``measure(effort)`` returns its tables."""
