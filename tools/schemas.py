"""Write the JSON Schemas of scenarios/schema from the settings classes: ``python -m tools.schemas``."""

from __future__ import annotations

from pathlib import Path

from flightbed.cli.schema import schema_text

FOLDER = Path(__file__).resolve().parents[1] / "scenarios" / "schema"


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for file in ("scenario", "campaign", "aircraft"):
        (FOLDER / f"{file}.json").write_text(schema_text(file), encoding="utf-8")  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
