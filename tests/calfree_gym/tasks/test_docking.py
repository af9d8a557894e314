"""Docking: geometry, wheels and marks against something independent, and the promises of all environments."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calfree_gym import nominal
from calfree_gym.image import lengths_px
from calfree_gym.perturbations import DockMoved, parse_perturbation
from calfree_gym.robot.docking.base import BASES, MARKS, Base, along
from calfree_gym.tasks.dock_frames import DockViewer
from calfree_gym.vision.dock_tags import prints
from calfree_gym.world import WorldDistribution
from tests.calfree_gym.environments import (
    alone,
    assert_checkers_pass,
    assert_same,
    begun,
    make,
    together,
    trials,
)

BASE = Base("differential", 1, 4)
RNG = np.random.default_rng
STILL = np.zeros(2)
TOLD = ("pose", "wheels")


def dock(rows=None, **arguments):
    return make("Dock", rows, **arguments)


def dock_at(pose, **arguments):
    return begun(dock(**arguments), options={"pose": pose})


def world(seed=0, name="wild", base=BASE, **fields):
    return WorldDistribution(name).sample(seed, robot=base).replace(**fields)


def exact(**fields):
    return world(**{"name": "nominal", "point_noise": 0, "slip": 0} | fields)


@pytest.mark.parametrize(
    "arguments",
    [
        *({}, {"base": "omni", "cameras": 2, "tell": TOLD}, {"goal": "shown", "marks": 2}),
        {"observation": "vision"},
    ],
)
@pytest.mark.parametrize("kind", ["", pytest.param("Dense", marks=pytest.mark.slow)])
def test_checkers_pass_without_a_warning(kind, arguments):
    assert_checkers_pass(lambda: make(f"Dock{kind}", **arguments))


def test_two_wheels_follow_the_exponential_of_a_planar_twist():
    ways = RNG(0).uniform(-1, 1, (50, 2))
    poses = along(np.zeros((50, 3)), BASE.arc(ways, np.full(50, 0.4)))
    for (left, right), pose in zip(ways, poses, strict=True):
        turn = (right - left) / 0.4
        there = expm(np.array([[0, -turn, (left + right) / 2], [turn, 0, 0], [0, 0, 0]]))
        np.testing.assert_allclose(pose[:2], there[:2, 2], atol=1e-12)
        assert pose[2] == pytest.approx(turn)
    whole, half = BASE.arc(ways, np.full(50, 0.4)), BASE.arc(ways / 2, np.full(50, 0.4))
    np.testing.assert_allclose(along(along(np.zeros((50, 3)), half), half), along(np.zeros((50, 3)), whole))


def test_omnidirectional_wheels_roll_as_the_rim_moves_where_they_stand():
    omni = Base("omni", 1, 4)
    ways, track = RNG(0).uniform(-1, 1, (20, 3)), 0.4
    ahead, left, turn = omni.arc(ways, np.full(20, track)).T
    for wheel, angle in enumerate(np.radians([60, -60, 180])):
        rim = -np.sin(angle) * ahead + np.cos(angle) * left + track / 2 * turn
        np.testing.assert_allclose(rim, ways[:, wheel])


def seen_by(of, pose):
    """Image points (d, 2) of the dock's marks from a pose, by SciPy's rotations."""
    turn = Rotation.from_euler("z", pose[2])
    in_base = turn.inv().apply(of.marks - [*pose[:2], 0])
    w, *xyz = of.camera_orientation[0]
    x, y, z = Rotation.from_quat([*xyz, w]).inv().apply(in_base - of.camera_position[0]).T
    flat = np.stack([x, -y], -1) / -z[:, None]
    bent = flat * (1 + of.lens_k1[0] * (flat**2).sum(-1, keepdims=True))
    return bent * of.focal_length[0] / 256


@pytest.mark.parametrize("seed", range(3))
def test_points_are_where_the_cameras_see_the_marks(seed):
    env = begun(dock().unwrapped, seed)
    env.set_world(env.world.replace(point_noise=0, slip=0))
    for observation, info in trials(env, 4, seed):
        for goal, pose in (("achieved_goal", info["truth"]["pose"]), ("desired_goal", np.zeros(3))):
            np.testing.assert_allclose(observation[goal].reshape(4, 2), seen_by(env.world, pose), atol=1e-6)
        assert observation["observation"][:8].all()


def test_words_roll_wheels_by_a_curve_of_each_word_and_add_up_in_the_odometer():
    of = exact(motor_curvature=[0.3, -0.2], motor_sign=[1, -1], motor_gain=[0.5, 2], link_lengths=[0.4])
    env = dock_at((-1, 0, 0), world=of, keep_in_view=False)
    pose, words = np.array([[-1.0, 0, 0]]), [(0.4, -0.1), (-0.2, 0.3), (0.4, -0.1)]
    for left, right in words:
        observation, *_, info = env.step(np.array([left, right]))
        ways = 0.5 * (left + 0.3 * left * (left**2 - 1)), -2 * (right - 0.2 * right * (right**2 - 1))
        pose = along(pose, BASE.arc(np.array([ways]), np.array([0.4])))
        np.testing.assert_allclose(info["truth"]["pose"], pose[0], atol=1e-12)
    np.testing.assert_allclose(observation["observation"][8:], np.sum(words, 0), atol=1e-6)


@pytest.mark.parametrize(("cameras", "name"), [(1, "wild"), (2, "wild"), (1, "coarse")])
def test_who_looks_docked_is_docked(cameras, name):
    env, rng = dock(cameras=cameras, world=name).unwrapped, RNG(0)
    for seed in range(6):
        env.reset(seed=seed)
        berths = env.arms._workspaces

        def meet(poses, images=berths.images):
            images, goals = (images(each[None], np.array([0]))[0][0] for each in (poses, np.zeros((1, 3))))
            return 256 * np.linalg.norm(images - goals, axis=-1).max((-2, -1)) <= env.tolerance_px

        poses = rng.uniform(-1, 1, (40_000, 3)) * [0.04, 0.04, np.radians(3)]
        border = rng.multivariate_normal(np.zeros(3), np.cov(poses[meet(poses)].T), 4000)
        low, high = np.zeros(4000), np.full(4000, 50.0)
        for _ in range(30):
            middle = (low + high) / 2
            inside = meet(border * middle[:, None])
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        border = border * low[:, None]
        offset, degrees = np.hypot(*border.T[:2]).max(), np.degrees(np.abs(border[:, 2])).max()
        assert offset <= 0.02
        assert degrees <= 2
        np.testing.assert_allclose([offset, degrees], berths.accuracy(0), rtol=0.08)


FLAT = exact(marks=MARKS * [0, 1, 1] + [0.9, 0, 0])
NO_ARM, TAUGHT = "robot's joints; it has none", {"goal": "shown", "keep_in_view": False}
MOTION = {"at": {"motion": 1}}


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ({}, {"pose": (0, 0)}, r"must be \(x, y, heading\) in m and rad"),
        ({}, {"pose": (-1, 0, 3)}, r"from the pose \[-1.0, 0.0, 3.0\] the dock is out of view"),
        ({}, {"pos": (-1, 0, 3)}, "'pos'; allowed: 'pose'"),
        (TAUGHT | {"world": exact(marks=MARKS + np.array([0, 2, 0]))}, None, "not all of them"),
        ({"base": "car"}, None, "base is 'car'.*differential, omni"),
        ({"cameras": 3}, None, "cameras is 3; it must be a whole number from 1 to 2"),
        ({"marks": 1}, None, "marks is 1; it must be a whole number from 2 to 4"),
        ({"goal": "taught"}, None, "goal is 'taught'.*marks, shown"),
        ({"tell": ("poses",)}, None, "'poses'.*pose, wheels"),
        ({"world": nominal()}, None, r"motor_sign has shape \(3,\)|camera_position has shape"),
        ({"world": exact(), "marks": 3}, None, r"World.marks has shape \(4, 3\); it must be \(3, 3\)"),
        ({"world": FLAT}, None, r"not in view.*to 0.02 m and 2 degrees. Its marks tell the pose to 0.0[3-9]"),
        (
            {"world": exact(marks=MARKS + np.array([0, 0, 0.22]))},
            None,
            r"marks at least 0\.05 m above or below",
        ),
        ({"tolerance_px": 6.0}, None, r"within tolerance_px 6 \(a smaller one tells it better\), the docked"),
        ({"perturbations": [{**MOTION, "do": {"type": "joint_zero"}}]}, None, NO_ARM),
        ({"perturbations": [{**MOTION, "do": {"type": "occluder"}}]}, None, "this robot is no arm"),
    ],
)
def test_what_cannot_be_is_told(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        dock(**arguments).reset(seed=0, options=options)


def test_only_robots_on_wheels_have_a_track():
    with pytest.raises(ValueError, match="track is of a robot on wheels"):
        make(perturbations=[{**MOTION, "do": {"type": "track"}}])


SCHEDULE = [
    {"at": {"motion": 2}, "do": {"type": "camera_aim", "camera": "front"}},
    {"at": {"motion": 3}, "do": {"type": "wheel_radius"}},
    {"at": {"motion": 4}, "do": {"type": "dock_moved"}},
    {"at": {"trial": 1}, "do": {"type": "point_dropout", "share": 0.1}},
    {"at": {"trial": 1}, "do": {"type": "backlash"}},
    {"at": {"trial": 2}, "do": {"type": "latency", "motions": 2}},
    {"drift": {"per": "motion"}, "do": {"type": "track"}},
    {"at": {"motion": 9}, "undo": 2},
]


CASES = [
    {},
    {"base": "omni", "cameras": 2, "tell": TOLD},
    {"goal": "shown", "perturbations": SCHEDULE},
    {"dynamics": "physics", "perturbations": SCHEDULE},
    pytest.param(
        {"observation": "vision", "perturbations": SCHEDULE[:1] + SCHEDULE[5:6]}, marks=pytest.mark.slow
    ),
]


@pytest.mark.parametrize("arguments", CASES, ids=["plain", "omni", "shown", "physics", "vision"])
def test_rows_copies_states_and_specs_go_on_alike_bit_by_bit(arguments):
    slow = arguments.keys() & {"dynamics", "observation"}
    rows, size = (2, 0.05) if slow else (3, 0.2)
    envs = dock(rows=rows, max_episode_steps=5, **arguments)
    motors = envs.single_action_space.shape[0]
    words = RNG(0).uniform(-size, size, (7 if slow else 16, rows, motors)).astype(np.float32)
    for row, found in enumerate(together(envs, words, seed=5)):
        env = dock(max_episode_steps=5, **arguments)
        assert_same(found, alone(env, words[:, row], seed=5 + row))
    env.reset()
    env.step(words[0, 0])
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    state = env.unwrapped.get_state()
    found = [[each.step(word) for word in words[:3, 1]] for each in (env, *copies)]
    env.unwrapped.set_state(state)
    assert_same(found[1:], [found[0]] * 2)
    assert_same([env.unwrapped.step(word)[0] for word in words[:3, 1]], [each[0] for each in found[0]])
    plain = dock(**arguments | {"world": env.unwrapped.world})
    again = gym.make(EnvSpec.from_json(plain.spec.to_json()))
    assert_same(alone(again, words[:3, 0], 1), alone(plain, words[:3, 0], 1))


def test_reward_and_end_follow_from_goals_alone():
    for kind in ("Dock", "DockDense"):
        env = begun(make(kind, tolerance_px=2.5, world=exact()).unwrapped, options={"pose": (-0.02, 0, 0)})
        seen = [env.step(np.array([0.005, 0.005])) for _ in range(8)]
        goals = ("achieved_goal", "desired_goal")
        achieved, desired = (np.array([each[0][key] for each in seen]) for key in goals)
        np.testing.assert_array_equal(env.compute_reward(achieved, desired, {}), [each[1] for each in seen])
        ends = env.compute_terminated(achieved, desired, {})
        np.testing.assert_array_equal(ends, [each[2] for each in seen])
        assert 0 < ends.sum() < len(ends)
        solved = [env.is_solved(each[-1]["truth"]) for each in seen]
        assert all(solved[i] for i in np.flatnonzero(ends))
        assert env.compute_terminated(achieved, achieved, {}).all()


def test_a_shown_goal_dies_with_the_camera_and_own_marks_do_not():
    knock = [{**MOTION, "do": {"type": "camera_aim", "camera": "front", "degrees": 8}}]
    errors = {}
    for goal in ("marks", "shown"):
        env = dock_at((0, 0, 0), goal=goal, world=exact(), perturbations=knock, terminate_on_success=False)
        errors[goal] = [env.step(STILL)[-1]["truth"]["error_px"] for _ in range(2)]
        env.reset(options={"pose": (-0.4, 0, 0)})
        env.reset(options={"pose": (0, 0, 0)})
        errors[goal].append(env.step(STILL)[-1]["truth"]["error_px"])
    np.testing.assert_allclose(errors["marks"], 0, atol=1e-9)
    assert errors["shown"][0] == pytest.approx(0, abs=1e-9)
    assert errors["shown"][1] > 30
    assert errors["shown"][2] == pytest.approx(0, abs=1e-9), "it was shown again"


def test_a_dock_that_moves_leaves_the_robot_where_it_is():
    moved = DockMoved(metres=0.1, azimuth=90, degrees=5).to_dict()
    schedule = [{**MOTION, "do": moved}, {"at": {"motion": 2}, "undo": 0}]
    env = dock(world=exact(), perturbations=schedule)
    _, info = env.reset(seed=0, options={"pose": (-0.8, 0.05, 0)})
    poses = [env.step(STILL)[-1]["truth"]["pose"] for _ in range(3)]
    np.testing.assert_allclose(poses[0], info["truth"]["pose"])
    turn = Rotation.from_euler("z", -5, degrees=True)
    expected = turn.apply([-0.8, 0.05 - 0.1, 0])[:2]
    np.testing.assert_allclose(poses[1], [*expected, np.radians(-5)], atol=1e-12)
    np.testing.assert_allclose(poses[2], poses[0], atol=1e-12)


def test_wheels_that_slip_go_astray_by_their_share_and_differ_each_time():
    env = begun(dock(world=exact(slip=0.02), keep_in_view=False, max_episode_steps=-1))
    turned = []
    for _ in range(400):
        before = env.unwrapped.arms.truth()["pose"][0]
        after = env.step(np.array([0.1, -0.1]))[-1]["truth"]["pose"]
        turned.append((after - before)[2])
    ways = (np.array(turned) + np.pi) % (2 * np.pi) - np.pi
    assert ways.mean() == pytest.approx(-0.2 / 0.35, rel=0.01)
    assert ways.std() == pytest.approx(0.02 * 0.1 * np.sqrt(2) / 0.35, rel=0.15)


def test_perturbations_of_wheels_do_what_they_say():
    def turned(kind, word=(0.1, 0.1), **settings):
        do = parse_perturbation({"type": kind, **settings})
        env = dock_at((-1, 0, 0), world=do.apply(exact(), RNG(0), BASE), keep_in_view=False)
        return env.step(np.array(word))[-1]["truth"]["pose"] + [1, 0, 0]

    assert turned("wheel_radius", wheel="left", factor=0.9)[2] == pytest.approx(0.1 * 0.1 / 0.35)
    assert turned("track", (-0.1, 0.1), factor=1.25)[2] == pytest.approx(0.2 / (1.25 * 0.35))
    assert turned("motor_gain", motor="left", factor=0.5)[0] < 0.08
    assert turned("motor_sign", motor="left")[2] == pytest.approx(0.2 / 0.35)


@pytest.mark.parametrize("change", [{"shortfall": 0.2}, {"word_gain": 0.5}, {"motor_gain": [0.8, 0.8]}])
def test_told_is_how_far_a_word_of_1_leads(change):
    env = dock_at((-1.5, 0, 0), world=exact(**change), tell=TOLD, keep_in_view=False)
    env.reset(options={"pose": (-1.5, 0, 0)})
    observation, *_ = env.step(np.ones(2))
    ahead = observation["wheels"][:6].reshape(2, 3).sum(0)[0]
    assert observation["pose"][0] + 1.5 == pytest.approx(ahead)


@pytest.mark.parametrize("base", BASES)
def test_drawn_worlds_are_those_of_their_seed_and_starts_see_the_dock(base):
    env, other = (dock(base=base, perturbations=[]).unwrapped for _ in range(2))
    worlds = []
    for seed in range(5):
        for observation, info in trials(env, 3, seed):
            assert observation["observation"][:4].all()
            x, y, heading = info["truth"]["pose"]
            assert -1.5 <= x <= -0.3
            assert abs(y) <= 0.5
            assert abs(np.degrees(heading)) <= 25
        other.reset(seed=seed)
        assert other.world == env.world
        worlds.append(env.world)
    assert len(set(worlds)) == 5


TWO = [(0.3, 0.3), (-0.3, -0.3), (-0.122, 0.122), (0.122, -0.122), (0.3, 0.1), (0.05, 0.02), (0.24, 0.0)]
THREE = [(-0.26, 0.26, 0), (0.15, 0.15, -0.3), (0.122, 0.122, 0.122), (-0.122, -0.122, -0.122)]
THREE += [(-0.134, 0.039, 0.252), (-0.012, 0.022, -0.01)]


@pytest.mark.parametrize(
    ("base", "words"), [("differential", each) for each in TWO] + [("omni", each) for each in THREE]
)
def test_physics_follows_the_arc_and_comes_to_rest(base, words):
    ends = {}
    for dynamics in ("kinematic", "physics"):
        of = exact(base=Base(base, 1, 4))
        env = dock_at((-1, 0.2, 0.3), base=base, world=of, dynamics=dynamics, keep_in_view=False)
        both = np.array([words, np.zeros(len(words))])
        ends[dynamics] = [env.step(each)[-1]["truth"]["pose"] for each in both]
    (arc, _), (there, later) = ends["kinematic"], ends["physics"]
    assert np.hypot(*(there - arc)[:2]) < 0.005
    assert abs(np.degrees((there - arc)[2])) < 1
    np.testing.assert_allclose(later, there, atol=1e-4)
    if (turn := arc[2] - 0.3) != 0:
        assert (there[2] - 0.3) / turn == pytest.approx(1, abs=0.04)


@pytest.mark.parametrize("cameras", [1, 2])
def test_frames_show_the_scene_and_what_each_camera_sees(cameras):
    frames = {"render_mode": "rgb_array", "width": 300, "height": 200}
    env = dock_at((-0.8, 0, 0), world="nominal", cameras=cameras, **frames)
    frame = env.render()
    assert frame.shape == (200, 300, 3)
    env.step(np.array([0.1, 0.1]))
    after = env.render()
    assert (frame[:, :200] != after[:, :200]).any()
    for top in range(0, 100 * cameras, 100):
        assert (frame != after)[top : top + 100, 200:].any()
    assert (frame[:100, 199] == 255).all() == (cameras == 1), "a single image has an edge in the scene"
    env.close()
    arms = env.unwrapped.arms
    viewer = DockViewer(arms)
    viewer._show(0)
    _, data = viewer._picture
    for i, mark in enumerate(env.unwrapped.world.marks):
        np.testing.assert_allclose(data.geom(f"dock{i}").xpos, mark)
        pair = np.mean([data.geom(f"own{i}{end}").xpos for end in (0, 1)], 0)
        np.testing.assert_allclose(pair - mark, [*arms.rolling.poses[0, :2], 0], atol=0.03)


def seeing(**arguments):
    return make("Dock", observation="vision", **arguments)


def built(**fields):
    of = WorldDistribution("nominal").sample(0, robot=Base("differential", 1, 4))
    return of.replace(**{"slip": 0} | fields)


@pytest.mark.parametrize("arguments", [{}, {"base": "omni", "cameras": 2, "dynamics": "physics"}])
def test_marks_are_found_where_projection_has_them(arguments):
    env = seeing(**arguments).unwrapped
    off, flags = [], []
    for seed in range(3):
        for observation, info in trials(env, 3, seed):
            true = info["truth"]["points"].reshape(-1, 2)
            goals = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
            seen = observation["observation"][: len(true)] > 0
            off += lengths_px(goals.reshape(-1, 2) - true)[seen].tolist()
            flags += seen.tolist()
    assert np.median(off) <= 0.5
    assert np.max(off) < 2.5
    assert np.mean(flags) > 0.95


def found(env, pose):
    """Flags of the dock's marks (4,) and of the own ones (4,) from a pose."""
    observation, _ = env.reset(options={"pose": pose})
    return observation["observation"][:8].reshape(2, 4).astype(bool)


def test_a_mark_is_not_seen_outside_the_picture_or_behind_an_own_print():
    env = begun(seeing(world=built(), keep_in_view=False))
    assert found(env, (-1, 0, 0)).all()
    turned = found(env, (-1, 0, np.radians(35)))
    assert turned[1].all()
    assert not turned[0].all()
    eye, covered = np.array([0.1, 0, 0.5]), 0
    for tag in prints(4):
        mark = MARKS[tag.mark]
        at = mark - [0, *tag.middle]
        if tag.own and at[2] != eye[2] and (times := (mark - eye)[2] / (at - eye)[2]) > 1:
            away = mark - (eye + times * (at - eye))
            assert not found(env, (*away[:2], 0))[0, tag.mark]
            assert found(env, (away[0], 0, 0)).all()
            covered += 1
    assert covered


def test_worlds_and_starts_have_all_tags_in_view():
    for cameras in (1, 2):
        env = seeing(cameras=cameras).unwrapped
        for seed in range(3):
            env.reset(seed=seed)
            assert env.arms._workspaces.seen(env.arms.rolling.before_dock()[:, None], np.array([0])).all()
    with pytest.raises(ValueError, match="all by tags of 13 pixels or more"):
        seeing(world=built(focal_length=[130.0]))


def test_a_world_that_was_set_keeps_its_goal_though_others_are_redrawn():
    for redraw in ("never", "trial"):
        knock = {"at": {"trial": 2}, "do": {"type": "camera_roll", "degrees": 3}}
        env = begun(make("Dock", goal="shown", redraw=redraw, perturbations=[knock]))
        env.unwrapped.set_world(env.unwrapped.world)
        first, after = (env.reset()[0]["desired_goal"] for _ in range(2))
        np.testing.assert_array_equal(first, after)
