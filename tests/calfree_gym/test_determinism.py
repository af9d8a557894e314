"""One seed, one trajectory, bit by bit: alone or in a batch, in a pool of worlds or another process."""

import gc
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from calfree_gym import WorldDistribution, nominal
from calfree_gym import world as worlds
from calfree_gym.perturbations import TYPES
from tests.arms.every import EVERY, arm_named
from tests.arms.own import ARMS
from tests.calfree_gym.environments import OF_ARMS, alone, assert_same, make, together
from tests.calfree_gym.robot.one_motor import FIELDS

SEEDS = [3, 14, 15, 92, 6]
SCHEDULE = [
    {"at": {"motion": 4}, "do": {"type": "camera_replace"}},
    {"every": {"trial": 2}, "do": {"type": "motor_gain"}},
    {"drift": {"per": "trial"}, "do": {"type": "camera_aim"}},
    {"drift": {"per": "motion"}, "do": {"type": "camera_roll"}},
    {"at": {"every": {"motion": 5}}, "do": {"type": "joint_zero"}},
    {"at": {"motion": 2}, "do": {"type": "point_outliers"}},
    {"at": {"motion": 3}, "do": {"type": "point_dropout"}},
    {"at": {"motion": 6}, "do": {"type": "latency"}},
]
OF_ANY_ARM = [
    {"at": {"motion": 4}, "do": {"type": "camera_replace"}},
    {"every": {"trial": 2}, "do": {"type": "motor_gain"}},
    {"drift": {"per": "trial"}, "do": {"type": "joint_zero"}},
    {"at": {"motion": 2}, "do": {"type": "backlash"}},
    {"at": {"trial": 0}, "do": {"type": "repeatability"}},
    {"at": {"trial": 0}, "do": {"type": "register_noise"}},
    {"at": {"motion": 1}, "do": {"type": "dead_zone", "words": 0.1}},
    {"at": {"motion": 3}, "do": {"type": "gear_ripple"}},
]


def words(seed, motors=3, motions=14, size=0.2):
    return np.random.default_rng(seed).uniform(-size, size, (motions, motors)).astype(np.float32)


def trajectory(env, seed):
    return alone(env, words(seed, *env.action_space.shape), seed)


def trajectories(seeds, threads, **arguments):
    envs = make(rows=len(seeds), threads=threads, **arguments)
    return together(envs, np.stack([words(seed, envs.action_space.shape[1]) for seed in seeds], 1), seeds)


def made_trajectory(spec, seed):
    return trajectory(gym.make(spec, disable_env_checker=True), seed)


@pytest.mark.parametrize(
    "perturbations", [pytest.param(None, marks=pytest.mark.slow), SCHEDULE], ids=["quiet", "perturbed"]
)
@pytest.mark.parametrize(
    ("mount", "dynamics"),
    [
        ("waist", "physics"),
        ("stand", "kinematic"),
        pytest.param("waist", "kinematic", marks=pytest.mark.slow),
        pytest.param("stand", "physics", marks=pytest.mark.slow),
    ],
)
def test_one_seed_is_one_trajectory(mount, dynamics, perturbations):
    arguments = {"camera_mount": mount, "dynamics": dynamics, "perturbations": perturbations}
    arguments |= {"max_episode_steps": 6, "tolerance_px": 70.0}
    singles = [trajectory(make(**arguments), seed) for seed in SEEDS]
    shown = [each for of_seed in singles for each in of_seed]
    assert any(terminated for _, _, terminated, *_ in shown)
    assert any(truncated for _, _, _, truncated, *_ in shown)
    assert len({tuple(of_seed[0][0]["desired_goal"]) for of_seed in singles}) == len(SEEDS)
    for threads in (1, 2):
        assert_same(trajectories(SEEDS, threads, **arguments), singles)
        assert_same(trajectories(SEEDS[::-1], threads, **arguments), singles[::-1])
        assert_same(trajectories(SEEDS[2:4], threads, **arguments), singles[2:4])


SEEN = {"camera_mount": "stand", "image_size": 48}
WILDER = WorldDistribution("wilder").sample(0).replace(shortfall=0.2)
ROUGH = [nominal(), replace(nominal(), **FIELDS), WILDER]
CASES = {
    **{
        f"Reach {kind}": ("Reach", 0.2, {"dynamics": "kinematic", "observation": kind, **SEEN})
        for kind in ("vision", "pixels", "rgb", "depth")
    },
    **{
        f"Reach rough {dynamics}": (
            "Reach",
            0.3,
            {"dynamics": dynamics, "world": ROUGH, "keep_in_view": False},
        )
        for dynamics in ("kinematic", "physics")
    },
    "Reach pool": ("Reach", 0.2, {"dynamics": "kinematic", "redraw": "trial", "pool": 3}),
    "SafeReach": ("SafeReach", 1.0, {}),
    "Grasp": ("Grasp", 0.3, {}),
    "Grasp any": ("Grasp", 0.1, {"orientation": "any"}),
    **{f"Grasp {kind}": ("Grasp", 0.1, {"observation": kind, **SEEN}) for kind in ("vision", "pixels")},
    "Insert": ("Insert", 0.3, {}),
}


@pytest.mark.parametrize(
    "case", [pytest.param(each, marks=[pytest.mark.slow] * (each == "Grasp vision")) for each in CASES]
)
def test_rows_are_single_environments_in_every_task(case, request):
    task, size, arguments = CASES[case]
    if "observation" in arguments:
        request.getfixturevalue("opengl")
    envs = make(task, rows=3, threads=2, max_episode_steps=8, **arguments)
    motions, motors = 3 if "observation" in arguments else 12, envs.action_space.shape[1]
    sent = np.stack([words(seed, motors, motions, size) for seed in range(3)], 1)
    if task == "Grasp":
        sent[..., -1] = 0
        sent[6:7, :, -1], sent[9:10, :, -1] = 1, -1  # jaws close, and open again
    for row, found in enumerate(together(envs, sent, 7)):
        of_row = {"world": ROUGH[row]} if "world" in arguments else {}
        env = make(task, max_episode_steps=8, **arguments | of_row)
        assert_same(found, alone(env, sent[:, row], 7 + row))
        env.close()
    envs.close()


def test_one_seed_is_one_trajectory_in_other_processes_and_from_saved_specs():
    envs = [make(perturbations=SCHEDULE, terminate_on_success=False)]
    envs += [make(arm=arm_named(name), perturbations=OF_ANY_ARM, terminate_on_success=False) for name in ARMS]
    here = [trajectory(env, 5) for env in envs]
    specs = [env.spec for env in envs]
    assert_same([made_trajectory(pickle.loads(pickle.dumps(spec)), 5) for spec in specs], here)
    assert_same([made_trajectory(EnvSpec.from_json(spec.to_json()), 5) for spec in specs], here)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as child:
        assert_same(list(child.map(made_trajectory, specs, [5] * len(specs))), here)


@pytest.mark.parametrize("dynamics", ["physics", pytest.param("kinematic", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", EVERY)
def test_one_seed_is_one_trajectory_of_any_arm(name, dynamics):
    arguments = {"arm": arm_named(name), "dynamics": dynamics, "perturbations": OF_ANY_ARM}
    singles = [trajectory(make(max_episode_steps=6, **arguments), seed) for seed in SEEDS[:2]]
    assert singles[0][0][0]["desired_goal"].tolist() != singles[1][0][0]["desired_goal"].tolist()
    for threads in (1, 2):
        assert_same(trajectories(SEEDS[:2], threads, max_episode_steps=6, **arguments), singles)


def test_a_new_world_field_moves_no_other_draw(monkeypatch):
    def several():
        return [trajectory(make(perturbations=SCHEDULE), seed) for seed in range(3)]

    before, wild, drawn = several(), worlds.DISTRIBUTIONS["wild"], []

    def with_a_new_field(draw, robot):
        drawn.append(draw("new_field").standard_normal(7))
        return wild(draw, robot)

    monkeypatch.setitem(worlds.DISTRIBUTIONS, "wild", with_a_new_field)
    assert_same(several(), before)
    assert drawn


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
    env, worlds = made(task), []
    for seed in range(SIZE):
        env.reset(seed=seed)
        worlds.append(env.world)
    return worlds


@pytest.mark.parametrize(
    ("task", "trials", "knocks"),
    [("Reach", 30, KNOCKS), ("Grasp", 4, None), ("SafeReach", 4, None), ("Dock", 4, None)],
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


ROWS = 128
STATUS = Path("/proc/self/status")


def resident_megabytes():
    gc.collect()
    (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize("seed", range(4))
def test_a_held_thing_is_held_alike_whatever_was_done_before(seed):
    fresh, used = (make("Grasp", orientation="any", terminate_on_success=False) for _ in range(2))
    trajectory(used, 50)
    for env in (fresh, used):
        env.reset(seed=seed)
    for word in words(seed, *fresh.action_space.shape, motions=6, size=0.5):
        assert_same(fresh.step(word)[-1]["truth"], used.step(word)[-1]["truth"])


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="reads memory from /proc")
@pytest.mark.parametrize("keep_in_view", [True, False])
def test_half_a_million_random_motions(keep_in_view):
    schedule = [{"every": {"motion": 900 + 7 * i}, "do": {"type": name}} for i, name in enumerate(OF_ARMS)]
    if not keep_in_view:
        drifting = [name for name in OF_ARMS if TYPES[name].drifts]
        schedule += [{"drift": {"per": "trial"}, "do": {"type": name}} for name in drifting]
    arguments = {"dynamics": "kinematic", "perturbations": schedule, "keep_in_view": keep_in_view}
    told = ("joint_angles", "joint_zeros", "gripper_position")
    env = make("ReachDense", ROWS, tell=told, **arguments).unwrapped
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    steps = 500_000 // ROWS + 1
    applied = set()
    for step in range(steps):
        for key, value in observation.items():
            space = env.observation_space[key]
            assert (value >= space.low).all(), key  # which no NaN is
            assert (value <= space.high).all(), key
        scale = rng.choice([0.02, 0.3, 1.0])
        words = rng.uniform(-scale, scale, (ROWS, 3)).astype(np.float32)
        observation, rewards, _, _, infos = env.step(words)
        assert np.isfinite(rewards).all()
        assert np.isfinite(infos["robot_seconds"]).all()
        for key in ("error_px", "distance_mm", "points", "gripper", "object", "joints"):
            assert np.isfinite(infos["truth"][key]).all(), key
        applied |= {perturbation.type for of_row in env.applied for perturbation in of_row}
        if step == steps // 5:
            before = resident_megabytes()
    assert applied == set(OF_ARMS)
    assert resident_megabytes() - before < 10
