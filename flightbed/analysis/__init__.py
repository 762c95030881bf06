"""A flight's trace, metrics, bound, events and summary."""
