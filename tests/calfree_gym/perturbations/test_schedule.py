"""Schedules: when events are due, what they draw, and how they are undone and applied."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calfree_gym import nominal
from calfree_gym.perturbations import TYPES, CameraRoll
from calfree_gym.perturbations.schedule import Event, PerturbationScheduler, Undo, parse_schedule
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import in_view

RNG = np.random.default_rng


def made(schedule, **arguments):
    arguments = {"dynamics": "kinematic", **arguments}
    return gym.make("CalFree/Reach-v0", perturbations=schedule, **arguments).unwrapped


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ({"motion": -1}, "perturbations.0.at.motion is -1"),
        ({"motion": 1.5}, "1.5; it must be a whole number"),
        ({"motion": True}, "True; it must be a whole number"),
        ({"every": {"trial": 0}}, "at.every.trial is 0"),
        ({"motion": 1, "trial": 2}, "must be one of"),
        (7, "must be one of"),
        ({"motoin": 3}, "did you mean motion"),
        ({"drift": {"per": "day"}}, "perturbations.0.at.drift.per is 'day'; allowed: motion, trial"),
        ({"drift": 3}, "perturbations.0.at.drift is 3; it must be {per: motion} or {per: trial}"),
    ],
)
def test_damaged_times(at, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule([{"at": at, "do": {"type": "camera_roll"}}])


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"evry": {"trial": 1}, "do": {"type": "lens"}}, "perturbations.0 has 'evry'.*did you mean every"),
        ({"every": {"trial": 0}, "do": {"type": "lens"}}, "perturbations.0.every.trial is 0"),
        ({"drift": {"per": "trials"}, "do": {"type": "lens"}}, "drift.per is 'trials' .did you mean trial"),
        ({"do": {"type": "lens"}}, "must be a mapping of do and one of at, every, drift"),
        (
            {"drift": {"per": "motion"}, "do": {"type": "motor_sign"}},
            "perturbations.0.drift has 'motor_sign', which has no small steps; allowed with it: at, every",
        ),
        ({"at": {"trial": 1}, "every": {"trial": 1}, "do": {"type": "lens"}}, "one of at, every, drift"),
    ],
)
def test_damaged_entries(entry, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule([entry])


def applied(schedule, trials=4, motions=3):
    """(trial, motion of the trial) before which something was applied; motion 0 is the reset."""
    env = made(schedule)
    found, seed = [], 0
    for trial in range(trials):
        _, info = env.reset(seed=seed)
        seed = None
        found += [(trial, 0)] * info["perturbed"]
        for motion in range(1, motions + 1):
            *_, info = env.step(np.full(3, 0.01))
            found += [(trial, motion)] * info["perturbed"]
            assert len(env.applied) == info["perturbed"]
    return found


def test_schedules_are_applied_when_they_say():
    roll = {"type": "camera_roll"}
    assert applied([{"at": {"motion": 4}, "do": roll}]) == [(1, 2)]
    assert applied([{"at": {"motion": 0}, "do": roll}]) == [(0, 1)]
    assert applied([{"at": {"trial": 2}, "do": roll}]) == [(2, 0)]
    assert applied([{"every": {"trial": 1}, "do": roll}]) == [(1, 0), (2, 0), (3, 0)]
    assert applied([{"every": {"motion": 5}, "do": roll}]) == [(1, 3), (3, 2)]
    assert applied([{"drift": {"per": "trial"}, "do": roll}]) == [(1, 0)]  # listed once, at its first step


REPLACED = {"at": {"trial": 1}, "do": {"type": "camera_replace", "camera": "left"}}
BACK = {"at": {"trial": 3}, "undo": 0}


@pytest.mark.parametrize(
    ("earlier", "change", "message"),
    [
        (REPLACED, {"undo": 1}, "perturbations.1.undo is 1; it must be the place .* at an earlier trial: 0"),
        (REPLACED, {"undo": True}, "undo is True"),
        (REPLACED, {"undo": "first"}, "undo is 'first'"),
        (REPLACED, {"at": {"trial": 1}}, "there is none"),
        (REPLACED, {"at": {"motion": 9}}, "an earlier motion: there is none"),
        ({**REPLACED, "at": {"every": {"trial": 1}}}, {}, "there is none"),
        (REPLACED, {"at": {"trail": 3}}, "perturbations.1.at has 'trail'"),
        (REPLACED, {"do": {"type": "lens"}}, "or of at and undo"),
    ],
)
def test_damaged_undoing(earlier, change, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule([earlier, BACK | change])


def test_undoing_brings_the_old_camera_back_and_leaves_the_rest():
    zoomed = {"at": {"trial": 2}, "do": {"type": "camera_zoom", "camera": "right", "factor": 1.1}}
    env = made([REPLACED, BACK, zoomed])
    worlds, listed = [], []
    for trial in range(4):
        env.reset(seed=5 if trial == 0 else None)
        worlds.append(env.world)
        listed.append([perturbation.to_dict() for perturbation in env.applied])
    assert listed[3] == [{"type": "undo", "event": 0}]
    for name in ("camera_position", "camera_orientation", "lens_k1", "focal_length"):
        at = [getattr(world, name) for world in worlds]
        assert (at[1][0] != at[0][0]).any()
        np.testing.assert_array_equal(at[3][0], at[0][0])
        np.testing.assert_array_equal(at[3][1], at[2][1])
    assert worlds[3].focal_length[1] == pytest.approx(1.1 * worlds[0].focal_length[1])


@pytest.mark.parametrize("redraw", ["trial", "never"])
def test_nothing_is_undone_in_another_world(redraw):
    """Neither where each trial has a world of its own, nor where one was set: there the old camera is not."""
    env, plain = made([REPLACED, BACK], redraw=redraw), made([], redraw=redraw)
    for trial in range(4):
        for each in (env, plain):
            each.reset(seed=5 if trial == 0 else None)
        if redraw == "never" and trial == 1:
            for each in (env, plain):
                each.set_world(nominal())
    assert [type(each).__name__ for each in env.applied] == ["Undo"]
    assert env.world == plain.world


def test_what_undoing_brings_back_must_be_in_view():
    wide = {"at": {"trial": 1}, "do": {"type": "camera_zoom", "camera": "left", "factor": 0.4}}
    away = {"at": {"trial": 2}, "do": {"type": "camera_aim", "camera": "left", "degrees": 40, "direction": 0}}
    env = made([wide, away, BACK], world="nominal")
    env.reset(seed=0)
    env.reset()
    env.reset()
    with pytest.raises(ValueError, match=r"the world after .*undo.* is not in view"):
        env.reset()


def test_every_and_drift_may_stand_within_at():
    do = {"type": "camera_roll"}
    for when in ({"every": {"motion": 5}}, {"drift": {"per": "trial"}}):
        assert parse_schedule([{"at": when, "do": do}]) == parse_schedule([{**when, "do": do}])


counts = st.sampled_from(["motion", "trial"]).flatmap(
    lambda clock: st.integers(0, 6).map(lambda count: {clock: count})
)
whens = st.one_of(
    st.builds(lambda count: {"at": count}, counts),
    st.builds(lambda count: {"every": {k: n + 1 for k, n in count.items()}}, counts),
    st.builds(lambda clock: {"drift": {"per": clock}}, st.sampled_from(["motion", "trial"])),
)
dos = st.sampled_from(sorted(TYPES)).map(lambda name: {"do": {"type": name}})
entries = st.builds(lambda when, do: {**when, **do}, whens, dos).filter(
    lambda entry: "drift" not in entry or TYPES[entry["do"]["type"]].drifts
)


@settings(max_examples=40)
@given(
    st.lists(entries, max_size=4),
    st.integers(0, 100),
    st.booleans(),
)
def test_any_schedule_runs_and_stays_in_bounds(schedule, seed, keep_in_view):
    env = made(schedule, keep_in_view=keep_in_view)
    rng = RNG(seed)
    for trial in range(3):
        observation, _ = env.reset(seed=seed if trial == 0 else None)
        for _ in range(4):
            assert env.observation_space.contains(observation)
            observation, *_ = env.step(rng.uniform(-1, 1, 3))


def test_what_is_applied_does_not_depend_on_what_the_agent_did():
    def worlds(words):
        schedule = [{"at": {"every": {"motion": 3}}, "do": {"type": "camera_replace"}}]
        env = made(schedule)
        env.reset(seed=9)
        found = []
        for i in range(12):
            env.step(np.full(3, words))
            if i % 4 == 3 and words > 0.1:
                env.reset()
            found.append(env.world)
        return found

    assert worlds(0.01) == worlds(0.3)


def test_a_perturbation_that_is_never_in_view_is_an_error_that_names_it():
    schedule = [{"at": {"motion": 0}, "do": {"type": "camera_aim", "camera": "left", "degrees": 180}}]
    env = made(schedule)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"camera_aim.*never in view"):
        env.step(np.zeros(3))


def test_the_environment_lists_all_that_a_perturbation_drew():
    schedule = [{"at": {"motion": 1}, "do": {"type": "camera_roll"}}]
    env = made(schedule)
    env.reset(seed=0)
    env.step(np.zeros(3))
    before = env.world
    env.step(np.zeros(3))
    (drawn,) = env.applied
    assert drawn.degrees is not None
    assert drawn.change(before) == env.world


def drifted(do, trials, seed=0, **arguments):
    """The worlds of so many trials under a drift."""
    env = made([{"drift": {"per": "trial"}, "do": do}], world="nominal", camera_mount="stand", **arguments)
    worlds = []
    for trial in range(trials):
        env.reset(seed=seed if trial == 0 else None)
        worlds.append(env.world)
    return worlds


def angles_from_the_first(worlds):
    first = worlds[0].camera_orientation[0]
    return [2 * np.degrees(np.arccos(min(1.0, abs(w.camera_orientation[0] @ first)))) for w in worlds]


def test_a_pan_goes_on_and_turns_back_before_the_work_space_leaves_the_view():
    do = {"type": "camera_aim", "camera": "left", "degrees": 1.0, "direction": 0.0}
    worlds = drifted(do, 120)
    angles = angles_from_the_first(worlds)
    np.testing.assert_allclose(np.abs(np.diff(angles)), 1.0, atol=1e-3)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(angles))))
    assert len(turns) >= 2
    assert angles[turns[0] + 1] > 5
    assert all(in_view(world, MOVEMASTER, ("world", "world")) for world in worlds)


def test_a_pan_without_keeping_in_view_goes_on_and_on():
    do = {"type": "camera_aim", "camera": "left", "degrees": 1.0, "direction": 0.0}
    angles = angles_from_the_first(drifted(do, 120, keep_in_view=False))
    np.testing.assert_allclose(angles, np.arange(120.0), atol=1e-3)


def test_a_quantity_turns_back_at_the_ends_of_its_range():
    shares = [w.point_outliers.item() for w in drifted({"type": "point_outliers", "share": 0.25}, 11)]
    assert shares == [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0, 0.25, 0.5]
    late = [int(w.latency) for w in drifted({"type": "latency"}, 24)]
    assert late == [*range(11), *range(9, -1, -1), 1, 2, 3]


def test_a_drift_takes_its_way_from_the_seed_and_begins_anew_with_it():
    schedule = [{"drift": {"per": "motion"}, "do": {"type": "camera_shift"}}]
    env = made(schedule, world="wild")

    def worlds(seed):
        env.reset(seed=seed)
        found = []
        for _ in range(6):
            env.step(np.zeros(3, np.float32))
            found.append(env.world)
        return found

    first = worlds(1)
    assert first[0] != first[1]
    assert worlds(2) != first
    assert worlds(1) == first
    several = gym.make_vec(
        "CalFree/Reach-v0", num_envs=3, perturbations=schedule, dynamics="kinematic", world="wild"
    ).unwrapped
    several.reset(seed=[7, 1, 2])
    for _ in range(6):
        several.step(np.zeros((3, 3), np.float32))
    assert several.worlds[1] == first[-1]


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (("motions", 1, CameraRoll()), "did you mean motion"),
        (("motion", 0, CameraRoll(), True), "at is 0"),
        (("motion", 2.5, CameraRoll()), "at is 2.5"),
        (("motion", 2, "camera_roll"), "must be a Perturbation"),
        (("motion", 2, CameraRoll(), True, True), "one at every 1"),
        (("motion", 2, Undo(7)), "place of an entry before it"),
    ],
)
def test_damaged_events(event, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule([Event(*event)])


def test_a_schedule_may_be_an_iterator_and_serves_copies_too():
    entries = ({"at": {"motion": 0}, "do": {"type": "motor_sign", "motor": name}} for name in ["shoulder"])
    env = gym.make("CalFree/Reach-v0", world="nominal", dynamics="kinematic", perturbations=entries).unwrapped
    twin = copy.copy(env)
    for each in (env, twin):
        each.reset(seed=0)
        each.step(np.zeros(3))
        assert len(each.applied) == 1


WAIST = ("waist", "waist")
EVENT = {"every": {"trial": 1}, "do": {"type": "camera_roll", "camera": "left"}}
DRIFT = {"drift": {"per": "trial"}, "do": {"type": "camera_roll", "camera": "left"}}


def drawn(schedule, seeds=(0,), row=0, count=1):
    """The degrees that the events of a schedule draw for one row of several."""
    scheduler = PerturbationScheduler(len(seeds), schedule, MOVEMASTER, WAIST, keep_in_view=False)
    for each, seed in enumerate(seeds):
        scheduler.seed(each, seed)
    events = scheduler.events["trial"]
    return [scheduler.apply(place, event, row, count, nominal())[1].degrees for place, event in events]


@pytest.mark.parametrize("entry", [EVENT, DRIFT], ids=["event", "drift"])
def test_draws_depend_on_the_rows_own_seed(entry):
    assert drawn([entry], seeds=(3,)) == drawn([entry], seeds=(8, 3), row=1)
    assert drawn([entry], seeds=(3,)) != drawn([entry], seeds=(4,))
    assert drawn([entry], seeds=(3, 4), row=0) != drawn([entry], seeds=(3, 4), row=1)


@pytest.mark.parametrize("entry", [EVENT, DRIFT], ids=["event", "drift"])
def test_draws_depend_on_the_place_in_the_schedule(entry):
    degrees = drawn([entry] * 4)
    assert len(set(degrees)) == 4
    assert drawn([entry] * 2) == degrees[:2]


def test_draws_of_an_event_depend_on_the_count_and_those_of_a_drift_do_not():
    assert drawn([EVENT], count=1) != drawn([EVENT], count=2)
    assert drawn([DRIFT], count=1) == drawn([DRIFT], count=2)


def test_an_event_in_view_is_the_first_draw_that_is_in_view():
    scheduler = PerturbationScheduler(
        1, [{**EVENT, "do": {"type": "camera_aim", "camera": "left", "degrees": 25}}], MOVEMASTER, WAIST, True
    )
    ((place, event),) = scheduler.events["trial"]
    directions = []
    for seed in range(12):
        scheduler.seed(0, seed)
        world, perturbation = scheduler.apply(place, event, 0, 1, nominal())
        assert world == perturbation.change(nominal())
        directions.append(perturbation.direction)
    assert np.unique(directions).size == 12
