"""Pools of worlds: every trial is as in an environment that is put into that world by hand."""

import numpy as np
import pytest

from tests.calfree_gym.environments import assert_same, kinematic, make

SIZE = 3
KNOCKS = [
    {"every": {"motion": 4}, "do": {"type": "camera_roll", "camera": "left"}},
    {"every": {"motion": 5}, "do": {"type": "point_noise", "px": 3}},
    {"every": {"motion": 6}, "do": {"type": "backlash", "degrees": 2}},
    {"every": {"motion": 7}, "do": {"type": "latency", "motions": 1}},
    {"every": {"motion": 8}, "do": {"type": "gear_ripple", "period": 0.25, "depth": 0.5}},
]


def made(task, **arguments):
    placed = {"dynamics": "kinematic"} if task == "Reach" else {}
    return make(task, max_episode_steps=3, terminate_on_success=False, **placed, **arguments).unwrapped


def drawn(task):
    """The worlds of the seeds 0 to `SIZE` - 1."""
    env, worlds = made(task), []
    for seed in range(SIZE):
        env.reset(seed=seed)
        worlds.append(env.world)
    return worlds


@pytest.mark.parametrize(
    ("task", "trials", "knocks"), [("Reach", 30, KNOCKS), ("Grasp", 4, None), ("SafeReach", 4, None)]
)
def test_a_trial_is_as_in_its_world_whatever_was_knocked_before(task, trials, knocks):
    pool, by_hand = (
        made(task, redraw="trial", pool=SIZE, perturbations=knocks),
        made(task, perturbations=knocks),
    )
    worlds, rng = drawn(task), np.random.default_rng(0)
    pool.reset(seed=77)
    by_hand.reset(seed=77)
    seen = [worlds.index(pool.world)]
    for _ in range(trials):
        for env in (pool, by_hand):
            for words in rng.uniform(-0.2, 0.2, (3, *pool.action_space.shape)):
                env.step(words.astype(np.float32))
        looks = [pool.reset()]
        seen.append(worlds.index(pool.world))
        by_hand.set_world(worlds[seen[-1]])
        looks.append(by_hand.reset())
        words = rng.uniform(-0.2, 0.2, pool.action_space.shape).astype(np.float32)
        looks += [pool.step(words), by_hand.step(words)]
        for first, second in (looks[:2], looks[2:]):
            assert_same(first[0], second[0])
    assert set(seen) == set(range(SIZE)) or trials < 10


def test_rows_take_worlds_as_single_environments_do():
    rows = kinematic(4, redraw="trial", pool=SIZE, max_episode_steps=3)
    single = [made("Reach", redraw="trial", pool=SIZE) for _ in range(4)]
    seen, _ = rows.reset(seed=5)
    taken = []
    for _ in range(6):
        for row, env in enumerate(single):
            first, _ = env.reset(seed=5 + row if not taken else None)
            np.testing.assert_array_equal(first["achieved_goal"], seen["achieved_goal"][row])
        taken.append([each.camera_position.tobytes() for each in rows.unwrapped.worlds])
        assert taken[-1] == [env.world.camera_position.tobytes() for env in single]
        for _ in range(4):  # the last one resets
            seen, *_ = rows.step(np.zeros((4, 3), np.float32))
        for env in single:
            for _ in range(3):
                env.step(np.zeros(3, np.float32))
    assert len({*np.ravel(taken)}) == SIZE
    assert len({tuple(each) for each in taken}) > 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pool": 0, "redraw": "trial"}, r"pool is 0; it must be a whole number"),
        ({"pool": 2.5, "redraw": "trial"}, r"pool is 2\.5; it must be a whole number"),
        ({"pool": 5}, "every trial takes a world of the pool: redraw is 'never'"),
    ],
)
def test_what_cannot_be_a_pool_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        made("Reach", **arguments)


def test_a_pool_has_worlds_of_one_distribution():
    with pytest.raises(ValueError, match="worlds of one distribution"):
        make(rows=2, world=["wild", "coarse"], redraw="trial", pool=5)
