"""The page of a campaign: headline, points, histories and distributions. The page of one flight is in ``report/``."""
