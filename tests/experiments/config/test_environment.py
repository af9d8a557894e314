"""What environments say of themselves: their task, and the arguments that it has."""

import gymnasium
import pytest

from experiments.config.environment import EnvironmentConfig


def test_an_environment_says_what_its_task_is_and_which_arguments_it_takes(monkeypatch):
    name, entry = "CalFree/Mine-v0", "calfree_gym.tasks.grasp:GraspEnv"
    monkeypatch.setitem(gymnasium.registry, name, gymnasium.envs.registration.EnvSpec(name, entry))
    mine = EnvironmentConfig(id=name, world="nominal", shape="bar")
    assert (mine.task, mine.tolerance_px) == ("grasp", 24)
    made = mine.make().unwrapped.config
    assert (made.shape, made.tolerance_px) == ("bar", 24)
    with pytest.raises(ValueError, match="dynamics is of reaching; CalFree/Mine-v0 has none"):
        EnvironmentConfig(id=name, world="nominal", dynamics="kinematic")


def test_inserting_has_a_clearance():
    narrow = EnvironmentConfig(id="CalFree/Insert-v0", world="wild", clearance=3.0)
    assert narrow.make().unwrapped.config.clearance == 3.0


def test_a_task_may_have_one_kind_of_dynamics_alone():
    said = "dynamics is 'kinematic'; in CalFree/SafeReach-v0 it is always 'physics'"
    with pytest.raises(ValueError, match=said):
        EnvironmentConfig(id="CalFree/SafeReach-v0", world="wild", dynamics="kinematic")
