"""Sections, tables and pictures, and the self-contained HTML page made of them."""
