"""Servos whose points are hidden by the arm, or by what stands in the way."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.servo.image_model.least_distance import Seeker
from agents.servo.image_model.smooth_points import SmoothPoints
from calfree_gym import Arm
from tests.agents.trials import motions_of
from tests.arms.own import ARMS


def reach(env, observation):
    """Whether the trial that has begun ends at the rendezvous, and its motions."""
    made = list(motions_of(agents.make("unified_servo", env), env, observation))
    return made[-1][2], len(made)


def test_hidden_points_cost_few_motions(mount, make_env):
    env = make_env(mount, occlusion=True)
    reached, motions = zip(*(reach(env, env.reset(seed=seed)[0]) for seed in range(5000, 5012)), strict=True)
    assert all(reached)
    assert np.mean(motions) < 11


@pytest.mark.slow
def test_an_arm_of_six_motors_goes_past_what_hides_its_points():
    reached = []
    for seed in range(5000, 5016):
        arguments = {"arm": Arm(**ARMS["torque"]), "world": "wild", "max_episode_steps": 40}
        env = gym.make("CalFree/Reach-v0", dynamics="kinematic", occlusion=True, **arguments)
        reached.append(reach(env, env.reset(seed=seed)[0])[0])
    assert np.mean(reached) > 0.5


def test_an_object_that_one_camera_does_not_see_from_home_is_not_waited_for(make_env):
    """It goes nearer by what the other camera sees, until both see it."""
    reached = []
    for seed in range(20):
        env = make_env(occlusion=True)
        env.reset(seed=seed)
        drawn = make_env(world=env.unwrapped.world)
        drawn.reset(seed=seed)
        for _ in range(12):
            place = drawn.reset()[1]["truth"]["object"]
            observation, _ = env.reset(options={"object": place})
            if observation["observation"][2:4].sum() == 1:
                reached.append(reach(env, observation)[0])
                break
    assert len(reached) > 8
    assert np.mean(reached) > 0.75


def test_an_image_in_which_the_object_was_never_seen_does_not_count():
    points = SmoothPoints(2)
    visible = np.array([True, True, True, False])
    for registers in ([0.0, 0.0], [0.1, 0.0], [0.0, 0.1]):
        seen = np.array([[registers[0], 0.0], [registers[1], 0.0], [0.3, 0.0], [0.0, 0.0]])
        points.look(Observation(seen, visible, np.array(registers)), 0.5)
    found = Seeker(points, np.zeros(2), -np.ones(2), np.ones(2), caution=0.1).seek()
    assert found.far, "so that a probe is made"
    assert found.registers[0] == pytest.approx(0.3, abs=0.06)
    assert abs(found.registers[1]) < 0.06, "nothing is known of the other image"
