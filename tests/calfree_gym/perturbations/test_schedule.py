"""Schedules: when events are due, what they draw, and how they are undone and applied."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calfree_gym import nominal
from calfree_gym.perturbations import TYPES, CameraRoll
from calfree_gym.perturbations.schedule import (
    Event,
    PerturbationScheduler,
    Undo,
    in_motions_and_trials,
    parse_schedule,
)
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import in_view
from tests.calfree_gym.environments import OF_ARMS, begun, kinematic, trials

RNG = np.random.default_rng


ROLL, LENS = {"type": "camera_roll"}, {"type": "lens"}
REPLACED = {"at": {"trial": 1}, "do": {"type": "camera_replace", "camera": "left"}}
BACK = {"at": {"trial": 3}, "undo": 0}


def made(schedule, **arguments):
    return kinematic(perturbations=schedule, **arguments).unwrapped


def rolled(**when):
    return [{**when, "do": ROLL}]


def undone(**change):
    return [REPLACED, BACK | change]


def written(schedule):
    return [Event(*schedule)] if isinstance(schedule, tuple) else schedule


@pytest.mark.parametrize(
    ("schedule", "message"),
    [
        (rolled(at={"motion": -1}), "perturbations.0.at.motion is -1"),
        (rolled(at={"motion": 1.5}), "1.5; it must be a whole number"),
        (rolled(at={"motion": True}), "True; it must be a whole number"),
        (rolled(at={"every": {"trial": 0}}), "at.every.trial is 0"),
        (rolled(at={"motion": 1, "trial": 2}), "must be one of"),
        (rolled(at=7), "must be one of"),
        (rolled(at={"motoin": 3}), "did you mean motion"),
        (rolled(at={"drift": {"per": "day"}}), "0.at.drift.per is 'day'; allowed: motion, trial"),
        (rolled(at={"drift": 3}), "at.drift is 3; it must be {per: motion} or {per: trial}"),
        (rolled(evry={"trial": 1}), "perturbations.0 has 'evry'.*did you mean every"),
        (rolled(every={"trial": 0}), "perturbations.0.every.trial is 0"),
        (rolled(drift={"per": "trials"}), "drift.per is 'trials' .did you mean trial"),
        (rolled(drift={"per": ["trial"]}), r"drift.per is \['trial'\].* allowed: motion, trial"),
        (rolled(), "must be a mapping of do and one of at, every, drift"),
        (rolled(at={"trial": 1}, every={"trial": 1}), "one of at, every, drift"),
        (
            [{"drift": {"per": "motion"}, "do": {"type": "motor_sign"}}],
            "perturbations.0.drift has 'motor_sign', which has no small steps; allowed with it: at, every",
        ),
        (undone(undo=1), "perturbations.1.undo is 1; it must be the place .* at an earlier trial: 0"),
        (undone(undo=True), "undo is True"),
        (undone(undo="first"), "undo is 'first'"),
        (undone(at={"trial": 1}), "there is none"),
        (undone(at={"motion": 9}), "an earlier motion: there is none"),
        (undone(at={"trail": 3}), "perturbations.1.at has 'trail'"),
        (undone(do=LENS), "or of at and undo"),
        ([REPLACED | {"at": {"every": {"trial": 1}}}, BACK], "there is none"),
        (("motions", 1, CameraRoll()), "did you mean motion"),
        (("motion", 0, CameraRoll(), True), "at is 0"),
        (("motion", 2.5, CameraRoll()), "at is 2.5"),
        (("motion", 2, "camera_roll"), "must be a Perturbation"),
        (("motion", 2, CameraRoll(), True, True), "one at every 1"),
        (("motion", 2, Undo(7)), "place of an entry before it"),
    ],
)
def test_damaged_schedules(schedule, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule(written(schedule))


@pytest.mark.parametrize("when", [{"every": {"motion": 5}}, {"drift": {"per": "trial"}}])
def test_every_and_drift_may_stand_within_at(when):
    assert parse_schedule(rolled(at=when)) == parse_schedule(rolled(**when))


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ({"at": {"step": 3}}, {"at": {"motion": 3}}),
        ({"every": {"episode": 2}}, {"every": {"trial": 2}}),
        ({"drift": {"per": "step"}}, {"drift": {"per": "motion"}}),
        ({"at": {"drift": {"per": "episode"}}}, {"drift": {"per": "trial"}}),
    ],
)
def test_steps_and_episodes_are_motions_and_trials(said, meant):
    ((event,), (same,)) = (parse_schedule(rolled(**when)) for when in (said, meant))
    assert event == same
    assert event.to_dict() == same.to_dict()
    ((entry,), (plain,)) = (rolled(**when) for when in (said, meant))
    assert parse_schedule([in_motions_and_trials(entry)]) == (same,)
    assert in_motions_and_trials(plain) == plain


def of_trials(env, count, seed=0):
    return [env.world for _ in trials(env, count, seed)]


def applied(schedule):
    """(trial, motion of the trial) before which something was applied; motion 0 is the reset."""
    env, found = made(schedule), []
    for trial, (_, info) in enumerate(trials(env, 4)):
        found += [(trial, 0)] * info["perturbed"]
        for motion in range(1, 4):
            *_, info = env.step(np.full(3, 0.01))
            found += [(trial, motion)] * info["perturbed"]
            assert len(env.applied) == info["perturbed"]
    return found


def test_schedules_are_applied_when_they_say():
    assert applied(rolled(at={"motion": 4})) == [(1, 2)]
    assert applied(rolled(at={"motion": 0})) == [(0, 1)]
    assert applied(rolled(at={"trial": 2})) == [(2, 0)]
    assert applied(rolled(every={"trial": 1})) == [(1, 0), (2, 0), (3, 0)]
    assert applied(rolled(every={"motion": 5})) == [(1, 3), (3, 2)]
    assert applied(rolled(drift={"per": "trial"})) == [(1, 0)]  # listed once, at its first step


def test_undoing_brings_the_old_camera_back_and_leaves_the_rest():
    zoomed = {"at": {"trial": 2}, "do": {"type": "camera_zoom", "camera": "right", "factor": 1.1}}
    env = made([REPLACED, BACK, zoomed])
    worlds = of_trials(env, 4, seed=5)
    assert [perturbation.to_dict() for perturbation in env.applied] == [{"type": "undo", "event": 0}]
    for name in ("camera_position", "camera_orientation", "lens_k1", "focal_length"):
        at = [getattr(world, name) for world in worlds]
        assert (at[1][0] != at[0][0]).any()
        np.testing.assert_array_equal(at[3][0], at[0][0])
        np.testing.assert_array_equal(at[3][1], at[2][1])
    assert worlds[3].focal_length[1] == pytest.approx(1.1 * worlds[0].focal_length[1])


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_in_whatever_order_all_is_undone_nothing_stays(order):
    changes = [{"at": {"motion": i}, "do": {"type": "image_noise", "levels": 5 + 4 * i}} for i in range(2)]
    undone = [{"at": {"motion": 2 + i}, "undo": place} for i, place in enumerate(order)]
    env = begun(made([*changes, *undone]))
    built = begun(made([])).world
    for _ in range(4):
        env.step(np.zeros(3))
    assert env.world == built


@pytest.mark.parametrize("redraw", ["trial", "never"])
def test_nothing_is_undone_in_another_world(redraw):
    env, plain = made([REPLACED, BACK], redraw=redraw), made([], redraw=redraw)
    for each in (env, plain):
        of_trials(each, 2, seed=5)
        if redraw == "never":
            each.set_world(nominal())
        of_trials(each, 2, seed=None)
    assert [type(each).__name__ for each in env.applied] == ["Undo"]
    assert env.world == plain.world


def test_what_undoing_brings_back_must_be_in_view():
    wide = {"at": {"trial": 1}, "do": {"type": "camera_zoom", "camera": "left", "factor": 0.4}}
    away = {"at": {"trial": 2}, "do": {"type": "camera_aim", "camera": "left", "degrees": 40, "direction": 0}}
    env = made([wide, away, BACK], world="nominal")
    of_trials(env, 3)
    with pytest.raises(ValueError, match=r"the world after .*undo.* is not in view"):
        env.reset()


counts = st.sampled_from(["motion", "trial"]).flatmap(
    lambda clock: st.integers(0, 6).map(lambda count: {clock: count})
)
whens = st.one_of(
    st.builds(lambda count: {"at": count}, counts),
    st.builds(lambda count: {"every": {k: n + 1 for k, n in count.items()}}, counts),
    st.builds(lambda clock: {"drift": {"per": clock}}, st.sampled_from(["motion", "trial"])),
)
dos = st.sampled_from(OF_ARMS).map(lambda name: {"do": {"type": name}})
entries = st.builds(lambda when, do: {**when, **do}, whens, dos).filter(
    lambda entry: "drift" not in entry or TYPES[entry["do"]["type"]].drifts
)


@settings(max_examples=40)
@given(st.lists(entries, max_size=4), st.integers(0, 100), st.booleans())
def test_any_schedule_runs_and_stays_in_bounds(schedule, seed, keep_in_view):
    env, rng = made(schedule, keep_in_view=keep_in_view), RNG(seed)
    for observation, _ in trials(env, 3, seed):
        for _ in range(4):
            assert env.observation_space.contains(observation)
            observation, *_ = env.step(rng.uniform(-1, 1, 3))


PAN = {"type": "camera_aim", "camera": "left", "degrees": 1.0, "direction": 0.0}


def drifted(do, trials, **arguments):
    schedule = [{"drift": {"per": "trial"}, "do": do}]
    return of_trials(made(schedule, world="nominal", camera_mount="stand", **arguments), trials)


def angles_from_the_first(worlds):
    first = worlds[0].camera_orientation[0]
    return [2 * np.degrees(np.arccos(min(1.0, abs(w.camera_orientation[0] @ first)))) for w in worlds]


def test_a_pan_goes_on_and_turns_back_before_the_work_space_leaves_the_view():
    worlds = drifted(PAN, 120)
    angles = angles_from_the_first(worlds)
    np.testing.assert_allclose(np.abs(np.diff(angles)), 1.0, atol=1e-3)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(angles))))
    assert len(turns) >= 2
    assert angles[turns[0] + 1] > 5
    assert all(in_view(world, MOVEMASTER, ("world", "world")) for world in worlds)


def test_a_quantity_turns_back_at_the_ends_of_its_range():
    shares = [w.point_outliers.item() for w in drifted({"type": "point_outliers", "share": 0.25}, 11)]
    assert shares == [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0, 0.25, 0.5]
    late = [int(w.latency) for w in drifted({"type": "latency"}, 24)]
    assert late == [*range(11), *range(9, -1, -1), 1, 2, 3]
    play = [w.backlash[1] for w in drifted({"type": "backlash", "motor": "shoulder", "degrees": 20}, 6)]
    np.testing.assert_allclose(np.degrees(play), [0, 20, 40, 20, 0, 20], atol=1e-9)


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
    several = begun(made(schedule, rows=3, world="wild"), seed=[7, 1, 2])
    for _ in range(6):
        several.step(np.zeros((3, 3), np.float32))
    assert several.worlds[1] == first[-1]


WAIST = ("waist", "waist")
EVENT = {"every": {"trial": 1}, "do": {"type": "camera_roll", "camera": "left"}}
ONCE = {"at": {"trial": 1}, "do": {"type": "camera_roll", "camera": "left"}}
DRIFT = {"drift": {"per": "trial"}, "do": {"type": "camera_roll", "camera": "left"}}


def drawn(schedule, seeds=(0,), row=0, count=1):
    scheduler = PerturbationScheduler(len(seeds), schedule, MOVEMASTER, WAIST, keep_in_view=False)
    for each, seed in enumerate(seeds):
        scheduler.seed(each, seed)
    events = scheduler.events["trial"]
    return [scheduler.apply(place, event, row, count, nominal())[1].degrees for place, event in events]


@pytest.mark.parametrize("entry", [EVENT, ONCE, DRIFT], ids=["event", "once", "drift"])
def test_draws_depend_on_the_rows_own_seed_the_place_and_of_events_that_return_on_the_count(entry):
    assert drawn([entry], seeds=(3,)) == drawn([entry], seeds=(8, 3), row=1)
    assert drawn([entry], seeds=(3,)) != drawn([entry], seeds=(4,))
    assert drawn([entry], seeds=(3, 4), row=0) != drawn([entry], seeds=(3, 4), row=1)
    degrees = drawn([entry] * 4)
    assert len(set(degrees)) == 4
    assert drawn([entry] * 2) == degrees[:2]
    assert (drawn([entry], count=1) == drawn([entry], count=2)) == (entry is not EVENT)


def test_an_event_in_view_is_the_first_draw_that_is_in_view():
    aimed = [{**EVENT, "do": {"type": "camera_aim", "camera": "left", "degrees": 40}}]
    schedulers = [
        PerturbationScheduler(1, aimed, MOVEMASTER, WAIST, keep_in_view=keep) for keep in (False, True)
    ]
    directions, in_view_of = [], []
    for seed in range(24):
        drawn = []
        for scheduler in schedulers:
            scheduler.seed(0, seed)
            ((place, event),) = scheduler.events["trial"]
            drawn.append(scheduler.apply(place, event, 0, 1, nominal()))
        (first, _), (world, perturbation) = drawn
        assert world == perturbation.change(nominal())
        assert in_view(world, MOVEMASTER, WAIST)
        directions.append(perturbation.direction)
        in_view_of.append(in_view(first, MOVEMASTER, WAIST))
        assert (first == world) == in_view_of[-1]
    assert np.unique(directions).size == 24
    assert len(set(in_view_of)) == 2


@pytest.mark.parametrize("world", ["nominal", "wild"])
def test_however_noisy_points_are_trials_begin(world):
    loud = {"at": {"trial": 1}, "do": {"type": "point_noise", "px": 512}}
    for seed in range(20):
        begun(made([loud], world=world), seed).reset()
