"""``python -m flightbed``, and the console command: an interrupt is one line even while the modules are still loading."""

from __future__ import annotations

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line."""
    try:
        from flightbed.cli.main import main as run
    except KeyboardInterrupt:
        print("flightbed: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
