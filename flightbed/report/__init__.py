"""Figures and pages of one flight and of a comparison. The page of a campaign is in ``campaigns/report/``."""
