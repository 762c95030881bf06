"""Control laws, their design, and the correction for lost effectiveness."""
