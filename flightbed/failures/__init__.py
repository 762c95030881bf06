"""Failures as functions of the tick: health of a surface or actuator, shift of the c.g. The plant applies them."""
