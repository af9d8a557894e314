"""The parts of `python -m experiments benchmark` by name, and what they measured as one JSON document."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import pandas as pd

from experiments.benchmarks import changes, coverage, priors
from experiments.benchmarks.arms import first_motions, rendezvous
from experiments.benchmarks.contact import first_grasps, insert, orientations
from experiments.benchmarks.knowledge import study as knowledge
from experiments.benchmarks.reaching import baselines, controllers, pixels
from experiments.benchmarks.sensitivity import study as sensitivity
from experiments.benchmarks.speed import grasping, pictures
from experiments.benchmarks.speed import rates as speed
from experiments.reporting.tables import Table
from experiments.running.versions import commit, versions

PARTS: dict[str, Callable[[], Iterator[Table]]] = {
    "servo": baselines.servo,
    "controllers": controllers.controllers,
    "models": controllers.models,
    "robust": controllers.robust,
    "table": baselines.table,
    "knowledge": knowledge.knowledge,
    "changes": changes.changes,
    "right_actions": changes.actions,
    "sac": baselines.sac,
    "priors": priors.priors,
    "sensitivity": sensitivity.tables,
    "coverage": coverage.coverage,
    "arms": rendezvous.arms,
    "pictures": pictures.pictures,
    "pixels": pixels.pixels,
    "grasping": grasping.grasping,
    "first_grasps": first_grasps.first_grasps,
    "insert": insert.insert,
    "orientations": orientations.orientations,
    "safe_start": first_motions.safe_start,
}
"""All but `speed`, which alone has peers."""


def measure(
    parts: Sequence[str], peers: Sequence[str], show: Callable[[Iterable[Table]], None]
) -> dict[str, Any]:
    """Measures some parts, and shows each table as soon as it is there.

    Args:
        parts: Names, `speed` included.
        peers: As `rates.speed` takes them.
        show: Called with each table.

    Returns:
        Plain values for JSON: tables, commit and versions; where speed was measured, its ratios and machine.
    """
    document: dict[str, Any] = {"commit": commit(), "versions": versions(), "tables": []}
    for part in parts:
        if part == "speed":
            found = speed.speed(peers).to_dict()
            document |= found
            tables: Iterable[Table] = [speed_table(found)]
        else:
            tables = PARTS[part]()
        for table in tables:
            show([table])
            document["tables"].append(table.to_dict())
    return document


def speed_table(found: dict[str, Any]) -> Table:
    """The ratios of a `Speed.to_dict()`."""
    columns = ["name", "unit", "ratio", "wanted", "ours", "other", "rounds"]
    frame = pd.DataFrame(found["ratios"], columns=columns).rename(
        columns={"name": "row", "wanted": "required", "ours": "ours a second", "other": "other a second"}
    )
    formats = {"ratio": ".2f", "required": ".2f", "ours a second": ",.0f", "other a second": ",.0f"}
    machine = ", ".join(f"{key} {value}" for key, value in found["machine"].items())
    return Table("speed", "Speed, as ratios", frame, formats, machine)


def dumped(document: dict[str, Any]) -> str:
    """The document as text; NumPy's numbers become plain ones."""
    return json.dumps(document, indent=2, default=lambda value: value.item())
