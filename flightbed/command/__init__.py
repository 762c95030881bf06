"""The pilot's commands as functions of time: one input shape per file. Their prefilter and the laws are elsewhere."""
