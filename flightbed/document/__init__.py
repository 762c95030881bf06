"""Sections, tables and pictures, and the self-contained HTML page made of them. The content of a page comes from the callers."""
