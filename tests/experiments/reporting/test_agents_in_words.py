"""Agents look the same in every figure, and differ within one."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import agents
from experiments.config.loading import read_yaml
from experiments.config.suite import AgentConfig
from experiments.reporting.figures import colour, in_words, lines_of
from experiments.running.versions import REPOSITORY

CONFIGS = REPOSITORY / "configs"
SUITES = [path for path in sorted(CONFIGS.glob("*.yaml")) if "agents" in read_yaml(path)]
NAMES = sorted({name for task in agents.tasks() for name in agents.names(task)})


def contrast_with_white(colour):
    """As WCAG 2 defines it."""
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return 1.05 / (linear @ (0.2126, 0.7152, 0.0722) + 0.05)


def agents_of(path):
    found = [{"name": each} if isinstance(each, str) else each for each in read_yaml(path)["agents"]]
    return [AgentConfig(name=each["name"], label=each.get("label", each["name"])) for each in found]


@pytest.mark.parametrize("path", SUITES, ids=lambda path: path.stem)
def test_no_two_agents_of_a_suite_look_the_same_or_are_called_the_same(path):
    of_suite = agents_of(path)
    lines = lines_of(of_suite)
    assert len(lines) == len(of_suite)
    for one, other in combinations(lines.values(), 2):
        assert (one["color"], one["linestyle"]) != (other["color"], other["linestyle"])
    assert len({in_words(each.label, each.name) for each in of_suite}) == len(of_suite)
    for each in of_suite:
        if each.label == each.name:
            assert lines_of([each])[each.label] == lines[each.label], "it looks the same everywhere"
            assert lines[each.label]["color"] == colour(each.label, each.name)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_read_on_white(name):
    assert contrast_with_white(colour(name, name)) >= 4.5
    variants = [AgentConfig(name=name, label=f"{name}_{i}") for i in range(2)]
    assert min(contrast_with_white(line["color"]) for line in lines_of(variants).values()) >= 3


def test_only_an_agent_called_by_its_name_has_words_for_it():
    assert in_words("ppo", "ppo") == "PPO (stable-baselines3)"
    assert in_words("memory", "grasp") == "memory"
    assert in_words("ppo_small", "ppo") == "ppo_small"
    assert in_words("learning_servo", "learning_servo") == "learning_servo"
