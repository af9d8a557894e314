"""Results that nobody made, so that what they come to is known."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import FinishedSuite
from experiments.running.run import runs_of

CAP = 60


def results(names: str, rows: Any, **fixed: Any) -> pd.DataFrame:
    """Trials as `results.parquet` has them: held-out ones that are a success, as far as nothing else is said.

    Args:
        names: Columns, separated by blanks.
        rows: What stands in them.
        **fixed: What stands in all rows of other columns.
    """
    data = pd.DataFrame(rows, columns=names.split())
    usual = {"scenario": "aimed", "agent": "servo", "phase": "eval", "value": np.nan, "in_view": True}
    usual |= {"world": 0, "trial": 0, "lifetime_motions": 0, "motions_since_perturbation": pd.NA}
    usual |= {"success": True, "error_px": 1.0, "distance_mm": 1.0, "expected_px": np.nan}
    data = data.assign(**{name: each for name, each in (usual | fixed).items() if name not in data})
    data["motions_since_perturbation"] = data["motions_since_perturbation"].astype("Int64")
    return data if "rendezvous" in data else data.assign(rendezvous=data["success"])


def finished_suite(suite: dict[str, Any], rows: pd.DataFrame | None = None) -> FinishedSuite:
    """The suite, with all its runs finished."""
    read = Suite.model_validate(suite)
    runs, none = runs_of(read), pd.DataFrame()
    told = {"oracle": ["object_registers"]}
    outcomes = {run.id: {"privileged": told.get(run.agent.name, []), "prior_knowledge": []} for run in runs}
    return FinishedSuite(Path(), read, "", runs, outcomes, {}, {}, none if rows is None else rows, none)
