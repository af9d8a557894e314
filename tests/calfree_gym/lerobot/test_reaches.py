"""Agents reach on the bench, over LeRobot's interface alone, with default settings."""

import numpy as np
import pytest

import agents
from calfree_gym.vision import TagTracker
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101
from tests.calfree_gym.lerobot.matrix import life, summary


@pytest.mark.parametrize("seed", [0, 1])
def test_a_servo_reaches_in_spite_of_sag_play_ticks_and_webcams(bench, seed):
    bench = bench(seed=seed)
    servo = agents.make("unified_servo", bench.env)
    reaches, mm = [], []
    for reach in bench.env.reaches(servo, 3):
        reaches.append(reach)
        mm.append(bench.robot.distance_mm())
    assert all(reach.reached for reach in reaches)
    assert reaches[0].motions <= 16
    assert max(mm) < 8
    assert reaches[0].px <= 4 < reaches[0].before.px
    assert reaches[0].after.visible.all()
    assert servo.num_timesteps == sum(reach.motions for reach in reaches)


def test_a_servo_reaches_by_printed_tags(bench):
    bench = bench(robot=FakeSO101(0, tags=True), marks=TagTracker())
    for reach in bench.env.reaches(agents.make("unified_servo", bench.env), 2):
        assert reach.reached
        assert bench.robot.distance_mm() < 8


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["unified_servo", "memory"])
def test_a_life_with_a_knocked_camera_and_a_motor_replaced(agent, opengl):
    lived = [life(agent, seed) for seed in range(2)]
    print("\n".join(summary(agent, lived)))
    motions, mm, reached = np.moveaxis(np.array(lived, float), -1, 0)
    assert reached.mean() >= 0.95
    assert np.median(mm) < 5
    assert np.median(motions[:, [10, 15]]) <= 20
