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
    assert np.mean(lengths[-20:]) < 3


def test_missing_points_are_waited_for():
    lengths = lived({"type": "point_dropout", "share": 0.3}, 400)
    assert max(lengths) < 60
    bare = lived({"type": "point_dropout", "share": 0.3}, 400, "unified_servo")
    assert np.mean(lengths[10:]) < 1.5 * np.mean(bare[10:])


def test_the_first_trial_is_the_bare_servos():
    assert lived(None, 30)[0] == lived(None, 30, "unified_servo")[0]
