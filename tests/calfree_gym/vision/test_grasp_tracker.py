"""The tracker of a gripper that grasps, against true projections in rendered images, and against drawings."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.vision import GraspMarks, GraspTracker, Mark
from calfree_gym.vision.tracking.grasp_tracker import POINTS
from calfree_gym.vision.tracking.gripper_fit import GripperLayout, fit_gripper
from calfree_gym.vision.tracking.parts import MarkPart
from tests.calfree_gym.environments import make

TIP, BASE, OBJECT, END_1, END_2 = (POINTS.index(name) for name in ("tip", "base", "object", "end_1", "end_2"))
LAYOUT = GripperLayout(lower=0.9, upper=0.4, surface=0.0)


def looks(mount):
    """What the tracker finds from home and after a motion, and what is true: points (9, 2, 2), and flags."""
    env = make("Grasp", camera_mount=mount, shape="bar", observation="vision")
    arms, rng = env.unwrapped.arms, np.random.default_rng(0)
    for seed in range(5):
        env.reset(seed=seed)
        for _ in range(2):
            yield (each[0].reshape(9, 2, -1) for each in (arms.points, arms.true_points, arms.visible))
            env.step(np.append(rng.uniform(-0.1, 0.1, 3), [rng.uniform(-0.5, 0.5), 0]))
    env.close()


def between_lines(one, other):
    """Angles (...) between lines along (..., 2), in degrees."""
    cosine = (one * other).sum(-1) / np.linalg.norm(one, axis=-1) / np.linalg.norm(other, axis=-1)
    return np.degrees(np.arccos(np.minimum(np.abs(cosine), 1)))


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_points_are_found_where_they_are_and_ends_are_the_same_in_both_images(opengl, mount):
    seen, errors, angles, alike = [], [], [], []
    for points, true, visible in looks(mount):
        away = PIXELS_PER_UNIT * np.hypot(*np.moveaxis(points - true, -1, 0))
        seen.append(visible[..., 0])
        errors.append(np.where(visible[..., 0], away, np.nan))
        (found, axis) = (each[END_1] - each[END_2] for each in (points, true))
        angles.append(between_lines(axis, found))
        along = (found * axis).sum(-1)
        alike.append(along[0] * along[1] > 0)
    errors = np.array(errors)
    assert np.mean(seen) > 0.95
    for point, most in ((TIP, 2), (BASE, 4), (OBJECT, 2)):
        assert np.nanmedian(errors[:, point]) < most
    assert np.median(angles) < 3
    if mount == "waist":
        assert np.mean(alike) > 0.85


def places_of_marks(base, axis, line, edge):
    """The middles (2,) of each mark of a gripper."""
    return {
        "jaw_1": [base + LAYOUT.lower * axis + line],
        "jaw_2": [base + LAYOUT.lower * axis - line],
        "fingers": [base + LAYOUT.upper * axis + side * line for side in (1, -1)],
        "edge_1": [base + edge],
        "edge_2": [base - edge],
    }


def drawn(base, axis, line, edge, object_, without=()):
    """An image (256, 256, 3) of a bar, by its ends, and before it the marks, squares of 9 px; all in px."""
    marks = GraspMarks()
    image = np.full((256, 256, 3), 128, np.uint8)
    one, other = (tuple(np.round(end).astype(int).tolist()) for end in object_)
    cv2.line(image, one, other, marks.object.rgb, 9)
    for name, middles in places_of_marks(base, axis, line, edge).items():
        if name not in without:
            for middle in middles:
                x, y = np.round(middle - 4.5).astype(int)
                cv2.rectangle(image, (x, y), (x + 8, y + 8), getattr(marks, name).rgb, cv2.FILLED)
    return image


def seen_from(turn, tilt, roll, size=60.0, base=(120.0, 80.0)):
    """Base, axis, half line of the jaws and half edge in px of a gripper under parallel rays."""
    turned, tilted, rolled = (
        np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in (turn, tilt, roll)
    )
    in_space, towards = np.eye(3), np.eye(3)
    in_space[:2, :2], towards[::2, ::2] = turned, tilted
    line, edge, axis = size * (rolled @ (towards @ in_space)[:2]).T
    return {"base": np.array(base), "axis": axis, "line": LAYOUT.line * line, "edge": LAYOUT.edge * edge}


LEFT = seen_from(0.4, 1.3, 1.7, base=(100, 60)) | {"object_": np.array([[60.0, 180], [110, 200]])}
RIGHT = seen_from(-0.5, 1.2, 1.4, 52, (150, 70)) | {"object_": np.array([[150.0, 190], [190, 168]])}
GRIPPER = ("jaw_1", "jaw_2", "edge_1", "edge_2", "fingers")


@pytest.fixture
def tracker():
    return GraspTracker(layout=LAYOUT)


@pytest.fixture
def before(tracker):
    return found(tracker, drawn(**LEFT), drawn(**RIGHT))


def found(tracker, left, right):
    points, visible = tracker(left, right)
    return 128 * (points.reshape(9, 2, 2) + 1), visible.reshape(9, 2)


def wanted(image):
    """Tip, base, jaws, edges and object (7, 2) in px of what is drawn."""
    gripper = {name: place for name, place in image.items() if name != "object_"}
    return np.array([*wanted_of_gripper(**gripper), image["object_"].mean(0)])


def wanted_of_gripper(base, axis, line, edge):
    """Tip, base, jaws and edges (6, 2) in px."""
    places = places_of_marks(base, axis, line, edge)
    return np.array([base + axis, base, *(places[name][0] for name in GRIPPER[:4])])


def test_a_drawn_gripper_is_found(before):
    points, visible = before
    assert visible.all()
    for camera, image in enumerate((LEFT, RIGHT)):
        np.testing.assert_allclose(points[:7, camera], wanted(image), atol=1.2)
        axis, true = points[END_1, camera] - points[END_2, camera], np.diff(image["object_"], axis=0)[0]
        assert between_lines(axis, true) < 2


def test_in_a_wider_image_lengths_are_alike_along_both_axes(tracker):
    square, wide = drawn(**LEFT), drawn(**RIGHT)
    margin = np.broadcast_to(wide[:1, :1], (256, 64, 3))
    wide = np.concatenate([wide, margin], 1)
    points, visible = tracker(square, wide)
    assert visible.all()
    px = 160 * points.reshape(9, 2, 2)[:, 1] + [160, 128]
    np.testing.assert_allclose(px[:7], wanted(RIGHT), atol=1.2)


@pytest.mark.parametrize("hidden", GRIPPER)
@pytest.mark.usefixtures("before")
def test_a_mark_that_is_hidden_is_told_by_the_others(tracker, hidden):
    moved = {**LEFT, "base": LEFT["base"] + [15, 9], "object_": LEFT["object_"] + 3}
    points, visible = found(tracker, drawn(**moved, without=(hidden,)), drawn(**RIGHT))
    assert visible[[TIP, BASE], 0].all()
    np.testing.assert_allclose(points[:6, 0], wanted(moved)[:6], atol=1.5)


def test_an_object_that_lies_still_is_where_it_was_though_some_of_it_is_hidden(tracker, before):
    covered = drawn(**LEFT)
    covered[170:210, 85:120] = 128
    points, visible = found(tracker, covered, drawn(**RIGHT))
    assert visible[OBJECT:].all()
    np.testing.assert_allclose(points[OBJECT:], before[0][OBJECT:], atol=0.1)


@pytest.mark.parametrize("by", [4, 30])
@pytest.mark.usefixtures("before")
def test_an_object_that_has_moved_is_where_it_is_seen_now(tracker, by):
    moved = {**LEFT, "object_": LEFT["object_"] + [0, by]}
    points, _ = found(tracker, drawn(**moved), drawn(**RIGHT))
    np.testing.assert_allclose(points[OBJECT, 0], moved["object_"].mean(0), atol=1.2)


def with_round(image, middle, colour):
    """`image` with a disc of 20 px in radius in place of its object."""
    return cv2.circle(drawn(**(image | {"object_": np.full((2, 2), -50.0)})), middle, 20, colour, cv2.FILLED)


def test_a_round_thing_that_moves_is_seen_by_what_shows_of_its_outline(tracker):
    colour = GraspMarks().object.rgb
    right = with_round(RIGHT, (170, 180), colour)
    points, visible = found(tracker, with_round(LEFT, (80, 190), colour), right)
    np.testing.assert_allclose(points[OBJECT, 0], (80.5, 190.5), atol=0.5)
    np.testing.assert_array_equal(points[END_1], points[END_2])  # it has no axis
    half_hidden = with_round(LEFT, (90, 180), colour)
    half_hidden[:, 95:120] = 128
    points, visible = found(tracker, half_hidden, right)
    assert visible[OBJECT].all()
    np.testing.assert_allclose(points[OBJECT, 0], (90.5, 180.5), atol=1.0)


@pytest.mark.parametrize("turn", [-0.1, 0.0, 0.12])
@pytest.mark.parametrize("by", [(0, 0), (7, -5)])
@pytest.mark.usefixtures("before")
def test_a_thing_that_moves_is_laid_over_what_shows_of_it_beside_the_gripper(tracker, turn, by):
    middle, half = LEFT["object_"].mean(0) + by, np.diff(LEFT["object_"], axis=0)[0] / 2
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ half
    moved = {**LEFT, "object_": np.array([middle - turned, middle + turned])}
    jaw = LEFT["base"] + LAYOUT.lower * LEFT["axis"] + LEFT["line"]
    moved["base"] = LEFT["base"] + middle + 0.7 * turned - jaw
    points, visible = found(tracker, drawn(**moved), drawn(**RIGHT))
    assert visible[OBJECT, 0]
    np.testing.assert_allclose(points[OBJECT, 0], middle + 0.5, atol=1.5)


@given(st.floats(-1.2, 1.2), st.floats(0.5, 1.9), st.floats(0, 6), st.sampled_from(["edge_1", "edge_2"]))
def test_right_angles_tell_an_edge_that_is_hidden(turn, tilt, roll, hidden):
    gripper = seen_from(turn, tilt, roll)
    dot, places = np.ones((5, 5), np.float32), places_of_marks(**gripper)
    parts = {name: [MarkPart.of(middle - 3, dot) for middle in middles] for name, middles in places.items()}
    scale = np.array([160.0, 120.0])
    whole = fit_gripper(parts, scale, LAYOUT, None)
    fit = fit_gripper(parts | {hidden: []}, scale, LAYOUT, whole)
    np.testing.assert_allclose(scale * (fit.points + 1), wanted_of_gripper(**gripper), atol=2.5)


@given(st.floats(-1.2, 1.2), st.floats(0.6, 1.2), st.floats(0, 6))
def test_jaws_are_seen_by_their_surface(turn, tilt, roll):
    layout, gripper = LAYOUT._replace(surface=0.08), seen_from(turn, tilt, roll, size=60.0)
    sine = np.hypot(*gripper["axis"]) / 60.0
    ahead = layout.surface * np.sqrt(1 - sine**2) / sine * gripper["axis"]
    places = places_of_marks(**gripper)
    dot, ends = np.ones((5, 5), np.float32), ("jaw_1", "jaw_2", "fingers")
    parts = {
        name: [MarkPart.of(middle - 3 + ahead * (name in ends), dot) for middle in middles]
        for name, middles in places.items()
    }
    scale = np.array([128.0, 128.0])
    fit = fit_gripper(parts, scale, layout, None)
    np.testing.assert_allclose(scale * (fit.points + 1), wanted_of_gripper(**gripper), atol=1.0)


def test_a_gripper_that_is_hidden_is_not_seen_and_stands_where_it_was(tracker, before):
    other = tracker.copy()
    tracker.reset()  # a copy goes on by itself
    points, visible = found(other, drawn(**LEFT, without=GRIPPER), drawn(**RIGHT))
    assert not visible[:6, 0].any()
    assert visible[:, 1].all()
    np.testing.assert_array_equal(points[:6, 0], before[0][:6, 0])


def test_colours_are_ones_own():
    marks = GraspMarks.from_dict(
        {"object": {"rgb": [250, 120, 20]}, "edge_1": {"rgb": [20, 220, 20]}}
        | {"fingers": {"rgb": [230, 20, 90]}, "jaw_1": {"rgb": [200, 20, 240]}}
    )
    assert marks.object == Mark((250, 120, 20))
    assert GraspMarks.from_dict(marks.to_dict()) == marks


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="must be GraspMarks; found 'red'"):
        GraspTracker("red")
    with pytest.raises(ValueError, match="fingers is missing, and no default differs enough"):
        GraspMarks.from_dict({"object": {"rgb": [250, 120, 20]}})
    with pytest.raises(ValueError, match="the right image has shape"):
        GraspTracker()(np.zeros((64, 64, 3), np.uint8), np.zeros((64, 64), np.uint8))


@given(st.floats(0, 6), st.sampled_from([1, -1]))
def test_an_axis_has_the_same_sign_whatever_sign_an_eigenvector_is_given(turn, sign):
    cosine, sine = np.cos(turn), np.sin(turn)
    shares = np.zeros((41, 41), np.float32)
    along = np.linspace(-15, 15, 61)
    shares[np.round(20 + sine * along).astype(int), np.round(20 + cosine * along).astype(int)] = 1
    part = MarkPart.of(np.zeros(2), shares)
    eigh = np.linalg.eigh
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.linalg, "eigh", lambda matrix: (eigh(matrix)[0], sign * eigh(matrix)[1]))
        axis = part.axis
    assert axis @ [2, 1] > 0
    assert abs(axis @ [-sine, cosine]) < 0.1 * np.linalg.norm(axis)
