"""Methods that only the studies use. Methods that fly are in ``estimation/`` and ``control/``."""
