"""Published studies, recomputed: one a module or folder, each a function ``study(Options) -> Document``."""
