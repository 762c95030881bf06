"""Load, inspect and query JSBSim models. The only package that imports jsbsim; the aircraft in flight is in ``plant/``."""
