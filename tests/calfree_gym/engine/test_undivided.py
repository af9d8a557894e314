"""What fails changes nothing: no event is applied twice, and no trial goes on in another world."""

from itertools import count

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.robot import workspace
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import in_view
from calfree_gym.world import WorldDistribution
from tests.calfree_gym.environments import assert_same, kinematic, make

REVERSED = {"do": {"type": "motor_sign", "motor": "shoulder"}}
OUT_OF_VIEW = {"do": {"type": "camera_aim", "camera": "left", "degrees": 170.0}}
FAR = (0.9, 0.0)


def sign(env):
    return int(env.unwrapped.world.motor_sign[1])


def test_a_reset_that_fails_applies_no_event_and_ends_the_trial():
    schedule = [{"at": {"trial": 1}, **REVERSED}]
    env = make("Grasp", world="nominal", shape="sphere", perturbations=schedule).unwrapped
    env.reset(seed=0)
    before = sign(env)
    with pytest.raises(ValueError, match=r"0\.9"):
        env.reset(options={"object": FAR})
    assert sign(env) == before
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(env.action_space.shape))
    env.reset()
    assert sign(env) == -before


@pytest.mark.parametrize("rows", [None, 2])
def test_a_reset_whose_arguments_are_wrong_changes_nothing(rows):
    env = kinematic(rows).unwrapped
    env.reset(seed=0)
    before = str(env.get_state())
    for wrong in ({"options": {"objekt": FAR}}, {"options": {"object": "here"}}):
        with pytest.raises(ValueError, match="obje"):
            env.reset(seed=1, **wrong)
        assert str(env.get_state()) == before


def test_where_no_world_can_be_drawn_the_next_motion_asks_for_a_reset(monkeypatch):
    env = kinematic().unwrapped
    env.reset(seed=0)

    def fails(*_):
        raise ValueError("no world is in view")

    monkeypatch.setattr(env.arms, "_draw_world", fails)
    with pytest.raises(ValueError, match="no world"):
        env.reset(seed=1)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3))


def test_where_no_world_can_be_drawn_an_arm_stays_in_its_own(monkeypatch):
    env = kinematic().unwrapped
    env.reset(seed=0)
    as_before = kinematic(world=env.world)
    mounts, wild = env.arms.mounts, WorldDistribution("wild")
    seed = next(s for s in count(1) if not in_view(wild.sample(s), MOVEMASTER, mounts, whole=True))
    monkeypatch.setattr(workspace, "ATTEMPTS", 1)
    with pytest.raises(ValueError, match="never in view"):
        env.reset(seed=seed)
    monkeypatch.undo()
    assert_same(env.reset(), as_before.reset(seed=seed))


def test_a_motion_before_which_an_event_fails_applies_none():
    schedule = [{"at": {"motion": 1}, **REVERSED}, {"at": {"motion": 1}, **OUT_OF_VIEW}]
    env = kinematic(world="nominal", perturbations=schedule)
    env.reset(seed=0)
    env.step(np.zeros(3))
    before = sign(env)
    for _ in range(2):
        with pytest.raises(ValueError, match="never in view"):
            env.step(np.zeros(3))
        assert sign(env) == before


def test_a_drift_that_fails_goes_on_from_where_it_was():
    """Its direction is drawn once, by the first of its steps that is applied."""
    drift = {"drift": {"per": "motion"}, "do": {"type": "camera_roll", "camera": "left"}}
    entries = [drift, {"at": {"motion": 1}, **OUT_OF_VIEW}]
    env = kinematic(world=nominal(), perturbations=entries).unwrapped
    env.reset(seed=0)
    env.step(np.zeros(3))
    before = env.world.camera_orientation
    with pytest.raises(ValueError, match="never in view"):
        env.step(np.zeros(3))
    np.testing.assert_array_equal(env.world.camera_orientation, before)
    assert env.get_state()["_scheduler"]["_drifts"] == {}
