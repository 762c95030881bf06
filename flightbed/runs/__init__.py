"""One run and its folder, and the folder of a comparison of runs. Many flights: ``campaigns/``."""
