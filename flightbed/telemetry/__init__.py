"""Flights in the Rerun viewer: a recording after the flight, or live. The only package that imports rerun."""
