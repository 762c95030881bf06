"""Aircraft overlays as data: the edits of a stock model, and their checks. Nothing here loads JSBSim: see ``fdm/`` for that."""
