"""Control laws, their design, and adaptation."""
