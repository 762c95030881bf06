"""Laws that command the load factor, and the throttle."""
