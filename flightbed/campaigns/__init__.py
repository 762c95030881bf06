"""Many flights over a grid or drawn at random: plan, workers, journal, table, summary and report. One flight and its folder: ``runs/``."""
