"""Aircraft overlays as data: what an overlay edits, and the tables of the stock model."""
