"""Any knowledge base over any servo, in worlds whose looks cannot be taken as they come."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from tests.agents.lengths import Lengths


def lived(sensing, motions=250, name="memory", **settings):
    perturbations = [{"at": {"trial": 0}, "do": sensing}] if sensing else None
    log = Lengths(gym.make("CalFree/Reach-v0", dynamics="kinematic", perturbations=perturbations))
    log.seed = 4
    agents.make(name, log, **settings).learn(motions)
    return log.lengths[:-1]


@pytest.mark.parametrize("knowledge", sorted(set(agents.KNOWLEDGE) - {"memory"}))
@pytest.mark.parametrize("servo", sorted(agents.SERVOS))
def test_any_knowledge_makes_any_servo_faster(knowledge, servo):
    lengths = lived(None, 700, "learning_servo", knowledge=knowledge, servo=servo)
    assert np.mean(lengths[-30:]) < 0.75 * np.mean(lengths[:3])


def test_late_looks_teach_nothing_false():
    """A look that comes one motion late shows the gripper where it was: as a pair it would be wrong."""
    lengths = lived({"type": "latency", "motions": 1})
    assert max(lengths) < 60
    assert np.mean(lengths[-20:]) < 1.8


def test_missing_points_are_waited_for():
    missing = {"type": "point_dropout", "share": 0.3}
    lengths, bare = lived(missing, 400), lived(missing, 400, "unified_servo")
    assert max(lengths) < 60
    assert np.mean(lengths[10:]) < 0.75 * np.mean(bare[10:])


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_trials_that_end_before_anything_was_seen_teach_nothing(share):
    perturbations = [{"at": {"trial": 0}, "do": {"type": "point_dropout", "share": share}}]
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic", perturbations=perturbations, max_episode_steps=4)
    env.reset(seed=3)
    agent = agents.make("memory", env).learn(300)
    assert agent.num_timesteps == 300


def test_what_is_damaged_is_refused_and_leaves_the_agent_as_it_was(tmp_path):
    log = Lengths(gym.make("CalFree/Reach-v0", dynamics="kinematic"))
    agent = agents.make("memory", log).learn(30)
    agent.save(tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as file:
        arrays = {name: file[name] for name in file.files}
    fresh = agents.make("memory", log)
    for name in ("registers", "carriers", "home", "usual_scores", "clock", "suspects/trials"):
        damaged = {key: array for key, array in arrays.items() if key != name}
        np.savez(tmp_path / "damaged.npz", **damaged)
        with pytest.raises(ValueError, match=r"damaged\.npz is damaged"):
            fresh.load(tmp_path / "damaged.npz")
        assert fresh.num_timesteps == 0
        assert len(fresh.knowledge.registers) == 0
    with pytest.raises(ValueError, match=r"on_change=recognise.*on_change=keep"):
        agents.make("memory", log, on_change="keep").load(tmp_path / "whole.npz")


@pytest.mark.parametrize("setting", [{"jump_px": "x"}, {"jump_px": -1}, {"every_look": "no"}])
def test_settings_that_are_not_allowed(setting):
    ((name, value),) = setting.items()
    with pytest.raises(ValueError, match=f"{name} is {value!r}"):
        agents.make("memory", gym.make("CalFree/Reach-v0"), **setting)


def test_the_first_trial_is_the_bare_servos():
    assert lived(None, 30)[0] == lived(None, 30, "unified_servo")[0]
