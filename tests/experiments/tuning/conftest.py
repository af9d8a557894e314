"""A configuration of seconds, and processes whose every lifetime is known beforehand."""

import itertools
import math

import pytest

from experiments.tuning.config import TuningConfig
from experiments.tuning.tuner import Lived, Tuner


class KnownLifetimes:
    """In place of `Lifetimes`: each comes to a function of its settings and its world, at a price.

    Attributes:
        made: Settings and index of the world of every lifetime.
    """

    def __init__(self, objective, cpu_seconds=1.0):
        self.objective, self.cpu_seconds = objective, cpu_seconds
        self.made = []

    def make(self, run, cpu_seconds, log):
        price = self.cpu_seconds
        if price > cpu_seconds:
            return Lived(None, None, cpu_seconds)
        found = self.objective(run.agent.settings, run.world)
        self.made.append((run.agent.settings, run.world))
        return Lived(None, found, price) if isinstance(found, str) else Lived(found, None, price)


@pytest.fixture
def tuning_data(suite_data):
    """As it stands in YAML."""
    scenario = suite_data["scenarios"][0] | {"evaluation": {"every": 45, "trials": 2}}
    return {
        "seed": 7,
        "tries": 20,
        "scenarios": [scenario | {"worlds": 2, "check_worlds": 4}],
        "agents": [
            {
                "name": "jacobian_servo",
                "scenario": "aimed",
                "ranges": {"damping": {"low": 0.001, "high": 1.0, "log": True}},
            }
        ],
    }


@pytest.fixture
def tune(tuning_data, tmp_path):
    """Tunes the agent with known lifetimes; returns what is published."""

    def tune(lifetimes, *, journal="studies", code="this", **changed):
        config = TuningConfig.model_validate(tuning_data | changed)
        folder = tmp_path / journal
        folder.mkdir(exist_ok=True)
        made_of = (lifetimes.make, {"code": code}, "commit")
        return Tuner(config, config.agents[0], folder, *made_of, say=lambda line: None).tune()

    return tune


def quadratic(settings, world):
    """Least at 0.2; worlds differ, and with them the settings' differences a little."""
    return 10.0 + world + (1 + world / 10) * math.log(settings["damping"] / 0.2) ** 2


def counted(objective, most):
    """The objective, until so many lifetimes have been made; then the process that tunes is killed."""
    left = itertools.count()

    def killed(settings, world):
        if next(left) >= most:
            raise KeyboardInterrupt
        return objective(settings, world)

    return killed
