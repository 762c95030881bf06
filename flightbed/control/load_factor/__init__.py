"""Laws that command the load factor, their design, and the autothrottle."""
