"""Wu, Zhang and Zhou (2000), recomputed."""
