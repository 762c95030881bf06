"""J. P. Sillence, Loop Gain Estimation for Adaptive Control, AFIT/GE/ENG/99M-27, March 1999 (algorithm by M. Pachter), recomputed."""
