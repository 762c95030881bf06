"""Control laws, their design, and the correction for lost effectiveness. Laws see measurements and estimates, never the truth."""
