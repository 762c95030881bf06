"""Evaluation of one flight: trace, metrics, Cramer-Rao bound, events, summary. Figures and pages: ``report/``; folders: ``runs/``."""
