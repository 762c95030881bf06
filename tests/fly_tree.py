"""Fly scenario files with the flightbed of one source tree: the subprocess of ``bits.py``.

    PYTHONPATH=TREE python -P tests/fly_tree.py TREE FOLDER FILE ...

Writes FOLDER/0.npz, FOLDER/1.npz, ...: the trace columns of each file, in the order of the arguments; a file that cannot be
flown leaves FOLDER/0.txt, its error, instead. FOLDER/versions.json holds the versions of everything that computes a flight.
Uses only the public names of flightbed, because the two trees of a comparison may be laid out differently.
"""

from __future__ import annotations

import json
import platform
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

import flightbed

COMPUTING = ("jsbsim", "numpy", "scipy", "numba", "llvmlite")


def main(tree: str, folder: str, *files: str) -> int:
    """Fly the files one after the other; return the exit code, 2 if flightbed is not that of the tree."""
    imported = Path(str(flightbed.__file__)).resolve()
    if not imported.is_relative_to(Path(tree).resolve()):
        print(
            f"{tree}: flightbed was imported from {imported}; remove what comes before it on sys.path", file=sys.stderr
        )
        return 2
    out = Path(folder)
    versions = {"python": platform.python_version(), **{name: version(name) for name in COMPUTING}}
    (out / "versions.json").write_text(json.dumps(versions))
    for number, file in enumerate(files):
        try:
            trace = flightbed.run(flightbed.load_scenario(file), rerun=False, report=False).trace
        except Exception as error:  # any failure of one tree is a result of the comparison
            (out / f"{number}.txt").write_text(f"{type(error).__name__}: {error}")
        else:
            np.savez(out / f"{number}.npz", **trace.columns)  # type: ignore[arg-type]
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
