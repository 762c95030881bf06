"""The commands ``trim`` and ``linearize``: one condition or a sweep, as rows, text and files."""
