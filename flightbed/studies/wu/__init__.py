"""Wu, Zhang and Zhou (2000), recomputed: detection and estimation of control effectiveness with a two-stage filter."""
