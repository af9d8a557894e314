"""What all knowledge bases have in common."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from calfree_gym.image import IMAGE_UNIT

NAMES = [name for name in agents.KNOWLEDGE if name != "memory"]
JACOBIAN = np.array([[1.1, 0.3, 0.1], [0.2, -0.9, 0.5], [1.0, 0.2, -0.3], [-0.1, -0.7, 0.6]])


def seen(registers):
    """What a smooth world shows at registers (..., 3)."""
    bent = 0.1 * np.stack([registers[..., 0] ** 2, registers[..., 1] * registers[..., 2]] * 2, -1)
    return registers @ JACOBIAN.T + bent


def taught(name, pairs=60, reach=0.3, world=seen, seed=0, **settings):
    knowledge = agents.KNOWLEDGE[name](3, **settings)
    for registers in np.random.default_rng(seed).uniform(-reach, reach, (pairs, 3)):
        knowledge.learn(world(registers), registers)
    return knowledge


def missed_px(recall, sensors):
    """How far from `sensors` the recalled registers lead, in the worse image."""
    apart = seen(recall.registers) - sensors
    return max(np.hypot(*apart[:2]), np.hypot(*apart[2:])) / IMAGE_UNIT


def recalled(knowledge, places):
    return [
        None if (r := knowledge.recall(place)) is None else (*r.registers, r.deviation_px) for place in places
    ]


@pytest.mark.parametrize("kalman", [False, True])
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15)
@given(st.lists(st.floats(-0.4, 0.4), min_size=3, max_size=3).map(np.array))
def test_what_was_learned_is_recalled_at_its_place_and_nothing_from_nothing(name, kalman, registers):
    knowledge = agents.KNOWLEDGE[name](3, kalman=kalman)
    assert knowledge.recall(np.zeros(4)) is None
    assert knowledge.jacobian(np.zeros(3)) is None
    for _ in range(6):
        knowledge.learn(seen(registers), registers)
    recall = knowledge.recall(seen(registers))
    assert missed_px(recall, seen(registers)) < 3
    assert 0 <= recall.deviation_px < 20


@pytest.mark.parametrize("name", [name for name in NAMES if name != "grid_table"])
def test_between_what_was_learned_it_is_as_right_as_it_says(name):
    knowledge = taught(name, 120)
    places = seen(np.random.default_rng(1).uniform(-0.25, 0.25, (40, 3)))
    recalls = [knowledge.recall(place) for place in places]
    missed = np.array([missed_px(*each) for each in zip(recalls, places, strict=True)])
    assert np.median(missed) < 3
    deviations = np.array([recall.deviation_px for recall in recalls])
    assert np.mean(missed < 3 * deviations + 1) > 0.9


@pytest.mark.parametrize("name", NAMES)
def test_what_is_restored_recalls_and_learns_alike_and_what_was_handed_out_stays(name):
    knowledge, again = taught(name), agents.KNOWLEDGE[name](3)
    arrays = knowledge.arrays()
    again.restore(arrays)
    before = {key: array.copy() for key, array in arrays.items()}
    places = np.random.default_rng(2).uniform(-0.5, 0.5, (30, 4))
    assert recalled(knowledge, places) == recalled(again, places)
    for registers in np.random.default_rng(0).uniform(-0.3, 0.3, (60, 3)):
        for each in (again, knowledge):
            each.learn(seen(registers) + 0.01, registers)
            for key, array in arrays.items():
                np.testing.assert_array_equal(array, before[key])
    assert recalled(knowledge, places) == recalled(again, places)
