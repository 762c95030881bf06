"""Many flights over a grid or drawn at random: plan, workers, journal, table and summary."""
