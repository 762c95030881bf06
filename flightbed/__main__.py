"""``python -m flightbed``."""

from flightbed.cli import main

main()
