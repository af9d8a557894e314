"""Support points where they are needed (paper, section 4.3)."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.knowledge.support_points import LocalFit, SupportPoints
from tests.agents.knowledge.test_knowledge import JACOBIAN, missed_px, seen
from tests.agents.knowledge.test_knowledge import taught as taught_any

taught = partial(taught_any, "support_points")


@pytest.mark.parametrize("count", range(1, 8))
def test_one_to_seven_points_are_enough_to_recall(count):
    knowledge = taught(count)
    sensors = seen(np.array([0.1, -0.1, 0.1]))
    recall = knowledge.recall(sensors)
    assert np.isfinite(recall.registers).all()
    if count == 1:
        np.testing.assert_allclose(recall.registers, knowledge.registers[0], atol=1e-9)
        assert recall.deviation_px > 0.9 * missed_px(recall, sensors)
    assert knowledge.jacobian(np.zeros(3)) is None


def test_a_jacobian_is_implied_where_enough_is_known():
    np.testing.assert_allclose(taught(100).jacobian(np.zeros(3)), JACOBIAN, atol=0.08)
    flat = SupportPoints(3)
    for registers in np.random.default_rng(0).uniform(-0.3, 0.3, (60, 3)) * [1, 1, 0]:
        flat.learn(seen(registers), registers)
    assert flat.jacobian(np.zeros(3)) is None


@settings(max_examples=30)
@given(st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3).map(np.array), st.floats(0.02, 0.15))
def test_a_fit_to_a_plane_is_the_plane(centre, apart):
    registers = centre + apart * np.array([[0, 0, 0], *np.eye(3), *-np.eye(3), [1, 1, 1]])
    fit = LocalFit(registers, registers @ JACOBIAN.T, np.full(8, 1e-4))
    np.testing.assert_allclose(fit.jacobian, JACOBIAN, atol=0.01)
    np.testing.assert_allclose(fit.weights(centre) @ registers, centre, atol=1e-4)
    there = centre + 0.5 * apart
    found, variance = fit.inverse(there @ JACOBIAN.T)
    np.testing.assert_allclose(found, there, atol=0.01 * apart)
    assert variance < 5


@pytest.mark.slow
def test_skill_improves_by_doing(live, make_env, mount):
    first, last = [], []
    for seed in (7, 8, 9):
        env = make_env(mount, world="wild")
        env.reset(seed=seed)
        _, lengths = live("support_points", env, motions=300)
        first.append(lengths[:3])
        last.append(lengths[-51:-1])
    assert np.mean(last) <= 1.8
    assert np.mean(first) >= 3


def test_the_bound_holds_and_the_most_uncertain_go():
    knowledge = taught(300, world=lambda r: seen(4 * r), points=40)
    assert len(knowledge.sensors) == 40
    assert knowledge.variances.max() < 40
    assert missed_px(knowledge.recall(np.zeros(4)), np.zeros(4)) < 20
