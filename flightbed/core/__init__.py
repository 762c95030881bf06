"""Units, errors, signals, actuator, atmosphere, atomic files, compiled functions: used by all packages, imports none of them."""
