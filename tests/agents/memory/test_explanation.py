"""What has changed? Against the geometry of cameras, and against worlds changed in a known way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.base.observation import camera_lengths_px
from agents.memory.camera_change import fit_camera
from agents.memory.explanation import as_seen_now, explain_drift, explain_jump
from agents.memory.pairs import Pairs
from agents.memory.remembered import Remembered
from calfree_gym.image import IMAGE_UNIT, lengths_px
from calfree_gym.perturbations import CameraAim, CameraRoll, CameraZoom, MotorGain, MotorSign
from tests.agents import analytic
from tests.agents.memory.gripper_views import known, noisy, seen_at, taught, trial, view, wild

PLACES = np.random.default_rng(0).uniform(-0.6, 0.6, (12, 3))
SEEN = noisy(np.random.default_rng(1), view(PLACES))
KNOWLEDGE = taught(120)


def turned(points, roll=0.0, tilt=0.0, pan=0.0, zoom=1.0, focus=1.2):
    """Image points (n, 2) after the camera was turned by angles (rad) about its centre, and zoomed."""
    cos, sin = np.cos([roll, tilt, pan]), np.sin([roll, tilt, pan])
    about_z = np.array([[cos[0], -sin[0], 0], [sin[0], cos[0], 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cos[1], -sin[1]], [0, sin[1], cos[1]]])
    about_y = np.array([[cos[2], 0, sin[2]], [0, 1, 0], [-sin[2], 0, cos[2]]])
    rays = np.column_stack([points / focus, np.ones(len(points))]) @ (about_y @ about_x @ about_z).T
    return zoom * focus * rays[:, :2] / rays[:, 2:]


@settings(max_examples=40)
@given(st.floats(-np.pi, np.pi), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.8, 1.25))
def test_a_turned_and_zoomed_camera_is_fitted_from_a_dozen_points(roll, tilt, pan, zoom):
    seen = SEEN.copy()
    seen[:, 2:] = turned(seen[:, 2:], roll, tilt, pan, zoom)
    change = fit_camera(KNOWLEDGE.gripper.function, 1, seen_at(PLACES, seen))
    elsewhere = view(np.random.default_rng(2).uniform(-0.5, 0.5, (60, 3)))
    mapped = change.sensors(elsewhere)
    off = np.hypot(*(mapped[:, 2:] - turned(elsewhere[:, 2:], roll, tilt, pan, zoom)).T) / IMAGE_UNIT
    np.testing.assert_array_equal(mapped[:, :2], elsewhere[:, :2])
    assert np.median(off) < 3
    assert change.deviation_px[0] == 0
    assert change.deviation_px[1] < 4


@pytest.fixture(scope="module", params=[4114, 4115])
def lived_in(request):
    world = wild(request.param)
    return world, known(world)


def changed(world, *perturbations):
    for perturbation in perturbations:
        world = perturbation.apply(world, np.random.default_rng(0))
    return world


def error_px(knowledge, pairs):
    """Median error in the worse camera."""
    return np.median(knowledge.errors(pairs)[0].max((0, 2)))


BOTH, LEFT = np.array([True, True]), np.array([True, False])


@pytest.mark.parametrize(
    ("perturbation", "cameras", "kinds", "left"),
    [
        (CameraAim(camera="left", degrees=8), LEFT, {"re-aimed", "moved"}, 0.3),
        (CameraRoll(camera="left", degrees=25), LEFT, {"rolled"}, 0.3),
        (CameraZoom(camera="left", factor=1.2), LEFT, {"zoomed", "moved"}, 0.3),
        (MotorSign(motor="elbow"), BOTH, {"arm changed"}, 0.3),
        (MotorGain(motor="shoulder", factor=0.8), BOTH, {"arm changed"}, 0.5),
    ],
)
def test_a_known_change_of_a_world_is_explained_and_what_was_known_predicts_again(
    lived_in, perturbation, cameras, kinds, left
):
    world, before = lived_in
    after = changed(world, perturbation)
    seen, held_out = trial(after, 100, places=20), trial(after, 101, places=20)
    explanation = explain_jump(before, seen, cameras, may_discard=True)
    assert explanation.kind in kinds
    mapped = explanation.known
    unavoidable = error_px(before, trial(world, 101, places=20))
    made = error_px(before, held_out) - unavoidable
    assert error_px(mapped, held_out) - unavoidable < left * made


def test_what_nothing_explains_is_a_replaced_camera(lived_in):
    world, before = lived_in
    seen = trial(world, 100, places=20)
    scattered = np.random.default_rng(0).uniform(-0.9, 0.9, (len(seen), 2))
    seen.sensors[:, :2] = scattered
    explanation = explain_jump(before, seen, LEFT, may_discard=True)
    assert explanation.kind == "replaced"
    assert not explanation.changes
    assert len(explanation.known.gripper) == 0
    assert explain_jump(before, seen, LEFT, may_discard=False).changes


def test_a_drift_is_explained_by_the_camera_that_drifts(lived_in):
    world, before = lived_in
    pan = CameraAim(camera="left", degrees=0.15, direction=0)
    recent = Pairs.none(3)
    for number in range(12):
        world = changed(world, pan)
        recent = recent + trial(world, 100 + number, places=3)
    step = trial(changed(world, *12 * [pan]), 0).sensors[0] - trial(world, 0).sensors[0]
    now = as_seen_now(recent, LEFT, step / 12, 111)
    np.testing.assert_array_equal(now.sensors[:, 2:], recent.sensors[:, 2:])
    np.testing.assert_array_equal(now.sensors[-4:], recent.sensors[-4:])
    explanation = explain_drift(before, now, LEFT)
    assert [change.camera for change in explanation.changes] == [0]
    mapped = explanation.known
    held_out = trial(world, 200, places=20)
    assert error_px(mapped, held_out) < 0.7 * error_px(before, held_out)
    assert camera_lengths_px(step).argmax() == 0


def grippers(env, registers):
    """Noise-free sensor vectors (n, 4) of the gripper at registers (n, 3)."""
    return np.array([analytic.points(env, each)[:2].ravel() for each in registers])


@pytest.mark.parametrize("camera", [0, 1])
def test_three_observations_of_a_turned_camera_tell_where_all_other_points_have_gone(make_env, camera):
    env, rng = make_env("stand", world="nominal", keep_in_view=False).unwrapped, np.random.default_rng(0)
    env.reset(seed=0)
    nominal, remembered = env.world, Remembered(3)
    places, elsewhere = rng.uniform(-0.25, 0.25, (100, 3)), rng.uniform(-0.25, 0.25, (30, 3))
    remembered.learn(seen_at(places, noisy(rng, grippers(env, places))))
    before, missed = grippers(env, elsewhere), []
    for _ in range(12):
        env.set_world(CameraAim(("left", "right")[camera], 20.0).apply(nominal, rng))
        registers = rng.uniform(-0.25, 0.25, (3, 3))
        pairs = seen_at(registers, noisy(rng, grippers(env, registers)))
        after = fit_camera(remembered.gripper.function, camera, pairs).sensors(before)
        off = lengths_px((after - grippers(env, elsewhere)).reshape(-1, 2, 2)[:, camera])
        missed.append(np.median(off))
    assert np.median(missed) < 3
