"""When held-out trials were made: since the beginning of a life, or since the last change of its world."""

import numpy as np
import pandas as pd


def with_clocks(rows: pd.DataFrame) -> pd.DataFrame:
    """Held-out trials, each with the `stretch` and the `clock` of its checkpoint.

    The stretch is how many times the world had changed before it, and the clock counts motions since the
    last time, or since the beginning. The agents' own trials tell of changes, too, after which nothing was
    held out.

    Args:
        rows: What `with_cost` returned.
    """
    since = pd.Series(
        rows["motions_since_perturbation"].astype("Float64").to_numpy(float, na_value=np.nan), rows.index
    )
    changed_at = rows["lifetime_motions"] - since
    stretch = changed_at.groupby([rows["agent"], rows["world"]]).rank("dense").fillna(0).astype(int)
    clocked = rows.assign(stretch=stretch, clock=since.fillna(rows["lifetime_motions"]))
    return clocked[clocked["phase"] == "eval"]
