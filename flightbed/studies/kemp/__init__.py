"""R. S. Kemp, Pseudo-Linear Identification and Its Application to Adaptive Control, MS thesis, Virginia Polytechnic Institute, 1987."""
