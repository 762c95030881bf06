"""Published studies, recomputed: one a module or folder, each a function that returns a ``base.Study``."""
