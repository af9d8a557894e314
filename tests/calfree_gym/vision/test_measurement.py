"""Outliers, dropout and latency against their definitions; redrawn worlds."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import MOUNTS, WorldDistribution, nominal
from calfree_gym.engine.sight import MeasurementModel
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import in_view
from tests.calfree_gym.environments import begun, kinematic, make, trials

LATE = {"type": "latency"}


def lifetime(world, motions):
    """Observed points (motions, 4, 2), flags and true points of a resting arm, in pixels."""
    env = begun(kinematic(world=world, terminate_on_success=False).unwrapped, 1)
    points, flags, true = [], [], []
    for _ in range(motions):
        observation, *_, info = env.step(np.zeros(3))
        found = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
        points.append(found.reshape(4, 2) * 256)
        flags.append(observation["observation"][:4] > 0)
        true.append(info["truth"]["points"].reshape(4, 2) * 256)
    return np.array(points), np.array(flags), np.array(true)


def test_outliers_are_a_share_of_the_points_anywhere_in_the_image():
    points, flags, true = lifetime(replace(nominal(), point_outliers=0.3), 1000)
    outlying = np.abs(points - true).max(-1) > 4
    assert flags.all()
    assert outlying.mean() == pytest.approx(0.3, abs=0.03)
    outliers = points[outlying]
    assert np.abs(outliers.mean(0)).max() < 20
    assert outliers.std(0) == pytest.approx([256 / np.sqrt(3)] * 2, rel=0.05)


def test_dropouts_are_a_share_of_the_points_not_seen_in_one_observation():
    points, flags, _ = lifetime(replace(nominal(), point_dropout=0.3), 1000)
    assert flags.mean() == pytest.approx(0.7, abs=0.03)
    lost = ~flags[1:]
    np.testing.assert_array_equal(points[1:][lost], points[:-1][lost])


def test_outliers_and_dropout_change_no_other_draw():
    plain, _, _ = lifetime(nominal(), 50)
    for changed in ({"point_outliers": 0.3}, {"point_dropout": 0.3}):
        points, flags, true = lifetime(replace(nominal(), **changed), 50)
        good = flags & (np.abs(points - true).max(-1) < 4)
        assert 50 < good.sum() < 200
        np.testing.assert_array_equal(points[good], plain[good])


@pytest.mark.parametrize("late", [1, 3])
def test_latency_delays_points_and_flags_and_nothing_else(late):
    words = np.random.default_rng(0).uniform(-0.2, 0.2, (12, 3))
    series_of = {}
    for latency in (0, late):
        env = make(world=replace(nominal(), latency=latency), tolerance_px=200.0).unwrapped
        observation, _ = env.reset(seed=3)
        series = [(observation, 0.0, False, {})]
        for word in words:
            observation, reward, terminated, _, info = env.step(word)
            series.append((observation, reward, terminated, info))
        series_of[latency] = series
    for now, (observation, reward, terminated, info) in enumerate(series_of[late]):
        prompt = series_of[0][max(now - late, 0)][0]
        np.testing.assert_array_equal(observation["achieved_goal"], prompt["achieved_goal"])
        np.testing.assert_array_equal(observation["desired_goal"], prompt["desired_goal"])
        np.testing.assert_array_equal(observation["observation"][:4], prompt["observation"][:4])
        same_time = series_of[0][now]
        np.testing.assert_array_equal(observation["observation"][4:], same_time[0]["observation"][4:])
        if info:
            goals = observation["achieved_goal"], observation["desired_goal"]
            assert reward == env.compute_reward(*goals, info)
            assert terminated == info["is_success"] == env.compute_terminated(*goals, info)
            assert info["truth"]["error_px"] == same_time[3]["truth"]["error_px"]


def test_redraw_gives_every_trial_a_world_of_its_own_and_the_same_ones_again():
    def worlds(motions):
        env, found = kinematic(redraw="trial").unwrapped, []
        for _ in trials(env, 4, seed=5):
            for _ in range(motions):
                env.step(np.zeros(3))
            found.append(env.world)
        return found

    once = worlds(0)
    assert len(set(once)) == 4
    assert worlds(3) == once
    batch = begun(kinematic(rows=2, redraw="trial"), 5)
    batch.reset()
    assert batch.unwrapped.worlds[0] == once[1]


@pytest.mark.parametrize("mount", MOUNTS)
def test_worlds_out_of_view_are_kept_where_that_is_asked_for(mount):
    turned = nominal().camera_orientation[:, [2, 3, 0, 1]] * [1, -1, -1, 1]
    blind = replace(nominal(), camera_orientation=turned)
    env = make(world=blind, camera_mount=mount, keep_in_view=False).unwrapped
    observation, info = env.reset(seed=0)
    np.testing.assert_array_equal(observation["observation"][:4], 0)
    np.testing.assert_array_equal(observation["desired_goal"], 0)
    assert np.abs(observation["achieved_goal"]).max() <= 1.1 * env.tolerance_px * IMAGE_UNIT
    assert not info["is_success"]
    mounts, worlds = MOVEMASTER.mounts(mount), map(WorldDistribution("wild").sample, range(300))
    seed, out = next((s, w) for s, w in enumerate(worlds) if not in_view(w, MOVEMASTER, mounts, whole=True))
    env = begun(make(camera_mount=mount, keep_in_view=False).unwrapped, seed)
    assert env.world == out


def test_outliers_and_dropout_are_independent_of_each_other():
    rows, motions = 1500, 16
    model = MeasurementModel(rows)
    world = replace(nominal(), point_noise=0.0, point_outliers=0.5, point_dropout=0.5)
    for row in range(rows):
        model.set_world(row, world)
        model.seed(row, row)
    true, visible = np.zeros((rows, 4, 2)), np.ones((rows, 4), bool)
    outliers, dropped = [], []
    for motion in range(motions):
        at = np.full(rows, motion)
        measured, seen = model.measure(true, visible, np.ones(rows, np.int64), at)
        outliers.append((measured != 0).any(-1))
        dropped.append(~seen)
    sides = [np.concatenate(flags, 1) - 0.5 for flags in (outliers, dropped)]
    correlations = 4 * sides[0].T @ sides[1] / rows
    assert correlations.shape == (4 * motions, 4 * motions)
    assert np.abs(correlations).max() < 6 / np.sqrt(rows)


def delivered(schedule, count=1):
    """Points as delivered in so many trials of 12 motions, home included (count, 13, 8)."""
    env = kinematic(world="nominal", terminate_on_success=False, max_episode_steps=99, perturbations=schedule)
    seen = []
    for first, _ in trials(env, count):
        observed = [first, *(env.step(np.full(3, 0.01))[0] for _ in range(12))]
        seen.append([np.concatenate([each["achieved_goal"], each["desired_goal"]]) for each in observed])
    return np.array(seen)


def test_latency_that_ends_and_begins_again_beside_another_event():
    schedule = [
        {"at": {"motion": 2}, "do": LATE | {"motions": 2}},
        {"at": {"motion": 4}, "do": LATE | {"motions": 0}},
        {"at": {"motion": 8}, "do": LATE | {"motions": 2}},
        {"at": {"motion": 8}, "do": {"type": "camera_roll", "camera": "left", "degrees": 0.0}},
    ]
    on_time, (late,) = delivered(None)[0], delivered(schedule)
    np.testing.assert_array_equal(late[9:], on_time[[9, 9, 9, 10]])
    np.testing.assert_array_equal(late[5:9], on_time[5:9])
    np.testing.assert_array_equal(late[:5], on_time[[0, 1, 2, 3, 3]])


@pytest.mark.parametrize("beside", [[], [{"drift": {"per": "motion"}, "do": {"type": "camera_roll"}}]])
def test_nothing_of_an_earlier_trial_is_delivered(beside):
    times = (({"trial": 0}, 3), ({"trial": 1}, 0), ({"motion": 16}, 3))
    schedule = [{"at": at, "do": LATE | {"motions": late}} for at, late in times]
    first, second = delivered(schedule + beside, count=2)
    of_first = {tuple(row[4:]) for row in first.round(4)}
    assert not of_first & {tuple(row[4:]) for row in second.round(4)}
