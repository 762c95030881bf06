"""One run and its folder; comparisons of runs."""
