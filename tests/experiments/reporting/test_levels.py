"""Every interval that the report shows is one of 95 %: of many worlds, that of SciPy."""

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from experiments.config.suite import ScenarioConfig, SweepConfig
from experiments.reporting.by_trial import Blocks
from experiments.reporting.finished_suite import with_cost
from experiments.reporting.held_out import moments, with_clocks
from experiments.reporting.sweep import points

WORLDS = 400
MOTIONS_OF_WORLD = 3 + np.minimum(np.random.default_rng(5).gamma(2, 4, WORLDS).round(), 50)
CAP = MOTIONS_OF_WORLD.max()


def is_of_the_median(estimate):
    exact = scipy.stats.quantile_test(MOTIONS_OF_WORLD, p=0.5).confidence_interval(0.95)
    assert (estimate.low, estimate.high) == (exact.low, exact.high)
    assert estimate.value == np.median(MOTIONS_OF_WORLD)


@pytest.fixture
def scenario(suite_data):
    env = suite_data["scenarios"][0]["env"] | {"max_episode_steps": int(CAP)}
    return ScenarioConfig(**suite_data["scenarios"][0] | {"motions": 300, "perturbations": [], "env": env})


@pytest.fixture
def rows(scenario):
    """One held-out trial a world."""
    data = pd.DataFrame({"world": range(WORLDS), "motions": MOTIONS_OF_WORLD.astype(int)})
    data = data.assign(scenario=scenario.name, agent="servo", phase="eval", lifetime_motions=300)
    data = data.assign(motions_since_perturbation=pd.NA, success=True, rendezvous=True, distance_mm=1.0)
    return with_clocks(with_cost(data.assign(error_px=1.0), scenario))


def all_of(worlds):
    """Between Wilson's interval of as many successes, and Clopper and Pearson's."""
    low, high = (
        scipy.stats.binomtest(worlds, worlds).proportion_ci(0.95, method=method).low
        for method in ("exact", "wilson")
    )
    return low, max(high, low + 0.01)


def test_the_table_of_moments(rows):
    found = moments(rows, WORLDS, int(CAP))["at the end"]
    is_of_the_median(found.motions)
    is_of_the_median(found.among_reached)
    low, high = all_of(WORLDS)
    assert low < found.success.low < high
    assert found.success.high == 1


def test_the_table_of_blocks():
    (found,) = Blocks(np.array([0.0, 1.0]), MOTIONS_OF_WORLD[:, None], shares=False).estimates()
    is_of_the_median(found)


def test_the_table_of_a_sweep():
    env = {"id": "CalFree/Reach-v0", "world": "nominal", "max_episode_steps": int(CAP)}
    sweep = SweepConfig(name="s", env=env, do={"type": "camera_roll"}, vary="degrees", over=(0,))
    data = pd.DataFrame({"world": range(WORLDS), "motions": MOTIONS_OF_WORLD, "value": 0.0})
    data = data.assign(scenario="s", agent="servo", in_view=True, success=True, rendezvous=True, error_px=1.0)
    (found,) = points(with_cost(data, sweep), sweep, "servo", WORLDS)
    is_of_the_median(found.motions)
    is_of_the_median(found.among_reached)
    low, high = all_of(WORLDS)
    assert low < found.success.low < high
