"""One flight: plan, assembly, loop, flight computer, record and pacing. Its evaluation is in ``analysis/``."""
