"""Models that the flight computer holds before take-off: short period, schedule, roll and yaw."""
