"""Flights -> the Rerun viewer: a file when the flight is over, or live. The only folder that imports rerun."""
