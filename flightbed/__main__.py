"""``python -m flightbed``, and the console command: an interrupt is one line even while the modules are still loading."""

from __future__ import annotations

import gc
import sys
from typing import NoReturn

# Loading 2,000 modules makes objects that stay. Searching them for garbage again and again takes a tenth of the time of a command.
_OBJECTS_BEFORE_A_SEARCH = 100_000


def main() -> NoReturn:
    """Run the command line."""
    gc.set_threshold(_OBJECTS_BEFORE_A_SEARCH, *gc.get_threshold()[1:])
    try:
        from flightbed.cli.main import main as run
    except KeyboardInterrupt:
        print("flightbed: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
