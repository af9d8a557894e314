"""Every interval that the report shows is one of 95 %, by SciPy's bootstrap of the same numbers."""

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from experiments.config.suite import ScenarioConfig, SweepConfig
from experiments.reporting.by_trial.estimates import Blocks
from experiments.reporting.finished_suite import MOTIONS, with_cost
from experiments.reporting.held_out.estimates import held_out_curve, moments
from experiments.reporting.sweep.estimates import points

WORLDS = 20
MOTIONS_OF_WORLD = 3 + np.random.default_rng(5).gamma(2, 4, WORLDS).round()


def expected(statistic):
    return scipy.stats.bootstrap(
        (MOTIONS_OF_WORLD,),
        statistic,
        confidence_level=0.95,
        n_resamples=20_000,
        method="percentile",
        rng=np.random.default_rng(7),
    ).confidence_interval


def trimmed(values, axis):
    return scipy.stats.trim_mean(values, 0.25, axis=axis)


@pytest.fixture
def scenario(suite_data):
    return ScenarioConfig(**suite_data["scenarios"][0] | {"motions": 300, "perturbations": []})


@pytest.fixture
def rows(scenario):
    """One held-out trial a world."""
    data = pd.DataFrame({"world": range(WORLDS), "motions": MOTIONS_OF_WORLD.astype(int)})
    data = data.assign(scenario=scenario.name, agent="servo", phase="eval", lifetime_motions=300)
    data = data.assign(motions_since_perturbation=pd.NA, success=True, distance_mm=1.0)
    return with_cost(data, scenario)


def test_the_table_of_moments(rows):
    found = moments(rows, "servo", WORLDS, cap=60)["at the end"]
    motions, success = found.motions_per_reach, found.success
    np.testing.assert_allclose((motions.low, motions.high), expected(trimmed), atol=0.25)
    wilson = scipy.stats.binomtest(WORLDS, WORLDS).proportion_ci(0.95, method="wilson")
    assert (success.low, success.high) == pytest.approx(tuple(wilson))


def test_the_bands_of_curves(rows, scenario):
    low, high = held_out_curve(rows, "servo", MOTIONS, WORLDS, scenario).band()
    np.testing.assert_allclose((low[0], high[0]), expected(np.mean), atol=0.25)


def test_the_table_of_blocks():
    (found,) = Blocks(np.array([0.0, 1.0]), MOTIONS_OF_WORLD[:, None]).estimates()
    np.testing.assert_allclose((found.low, found.high), expected(np.mean), atol=0.25)


def test_the_table_of_a_sweep():
    env = {"id": "CalFree/Reach-v0", "world": "nominal"}
    sweep = SweepConfig(name="s", env=env, do={"type": "camera_roll"}, vary="degrees", over=(0,))
    data = pd.DataFrame({"world": range(WORLDS), "motions": MOTIONS_OF_WORLD, "value": 0.0})
    data = data.assign(scenario="s", agent="servo", in_view=True, success=True)
    (found,) = points(data, sweep, "servo", WORLDS)
    np.testing.assert_allclose((found.motions.low, found.motions.high), expected(np.median), atol=0.5)
    wilson = scipy.stats.binomtest(WORLDS, WORLDS).proportion_ci(0.95, method="wilson")
    assert (found.success.low, found.success.high) == pytest.approx(tuple(wilson))
