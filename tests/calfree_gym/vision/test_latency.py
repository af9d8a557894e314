"""What is delivered late is what was observed so many motions before in the same trial."""

import gymnasium as gym
import numpy as np
import pytest

LATE = {"type": "latency"}


def points(schedule, trials=1, motions=12):
    """Object points as delivered in each trial and motion, home included (trials, motions + 1, 4)."""
    env = gym.make(
        "CalFree/Reach-v0",
        world="nominal",
        dynamics="kinematic",
        terminate_on_success=False,
        max_episode_steps=99,
        perturbations=schedule,
    )
    seen = []
    for trial in range(trials):
        observed = [env.reset(seed=0 if trial == 0 else None)[0]]
        observed += [env.step(np.full(3, 0.01))[0] for _ in range(motions)]
        seen.append([np.concatenate([each["achieved_goal"], each["desired_goal"]]) for each in observed])
    return np.array(seen)


def test_latency_that_ends_and_begins_again_beside_another_event():
    schedule = [
        {"at": {"motion": 2}, "do": LATE | {"motions": 2}},
        {"at": {"motion": 4}, "do": LATE | {"motions": 0}},
        {"at": {"motion": 8}, "do": LATE | {"motions": 2}},
        {"at": {"motion": 8}, "do": {"type": "camera_roll", "camera": "left", "degrees": 0.0}},
    ]
    on_time, (late,) = points(None)[0], points(schedule)
    np.testing.assert_array_equal(late[9:], on_time[[9, 9, 9, 10]])
    np.testing.assert_array_equal(late[5:9], on_time[5:9])
    np.testing.assert_array_equal(late[:5], on_time[[0, 1, 2, 3, 3]])


@pytest.mark.parametrize("beside", [[], [{"drift": {"per": "motion"}, "do": {"type": "camera_roll"}}]])
def test_nothing_of_an_earlier_trial_is_delivered(beside):
    times = (({"trial": 0}, 3), ({"trial": 1}, 0), ({"motion": 16}, 3))
    schedule = [{"at": at, "do": LATE | {"motions": late}} for at, late in times]
    first, second = points(schedule + beside, trials=2)
    of_first = {tuple(row[4:]) for row in first.round(4)}
    assert not of_first & {tuple(row[4:]) for row in second.round(4)}
