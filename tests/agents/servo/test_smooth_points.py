"""Smooth points against conditional Gaussians, finite differences and functions of known smoothness."""

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.image_model.gaussian_process import GaussianProcess, inverse
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.slopes import Slopes
from calfree_gym.image import IMAGE_UNIT

MOTORS = 4
NOISE_PX = 0.7


def wavy(rng, length, motors=MOTORS, spread=1.0):
    """A random function from registers (m,) to points (4, 2), as smooth as that, and its Jacobian (8, m)."""
    waves = rng.normal(scale=1 / length, size=(60, motors))
    phases = rng.uniform(0, 2 * np.pi, 60)
    sizes = rng.normal(scale=spread * np.sqrt(2 / 60), size=(8, 60))

    def points(registers):
        return (sizes @ np.cos(waves @ registers + phases)).reshape(4, 2)

    def jacobian(registers):
        return -(sizes * np.sin(waves @ registers + phases)) @ waves

    return points, jacobian


def looked(points, at, start=None, seen=None, motors=MOTORS):
    """What is known after looks at registers (n, m)."""
    known = SmoothPoints(motors, start)
    for i, registers in enumerate(at):
        visible = np.ones(4, bool) if seen is None else seen[i]
        known.look(Observation(points(registers), visible, registers), NOISE_PX)
    return known


@pytest.fixture
def rng():
    return np.random.default_rng(0)


RELATIVE = np.array([0.5, 2.0, 0.8, 1.25])
"""Lengths along four motors, beside each other."""


@pytest.fixture(params=["nothing", "slopes", "slopes and lengths"])
def scene(request, rng):
    """A function, looks at it, some of which miss points, and slopes and lengths from before or none."""
    points, jacobian = wavy(rng, 1.0)
    at = rng.uniform(-0.5, 0.5, (9, MOTORS))
    seen = rng.random((9, 4)) < 0.8
    start = Slopes.of(jacobian(at[0]), at[0], np.full((4, 1, 1), 0.02) * np.eye(MOTORS))
    if request.param == "slopes and lengths":
        start = start._replace(lengths=np.tile(RELATIVE, (2, 1)))
    return points, at, seen, start if request.param != "nothing" else None


def test_slopes_and_those_of_the_variances_are_derivatives(scene, rng):
    points, at, seen, start = scene
    known = looked(points, at, start, seen)
    for registers in rng.uniform(-0.4, 0.4, (5, MOTORS)):
        here, step = known.at(registers), 1e-5
        ahead, behind = (
            [known.at(registers + side * step * way) for way in np.eye(MOTORS)] for side in (1, -1)
        )
        slopes = [(a.points - b.points).reshape(8) / (2 * step) for a, b in zip(ahead, behind, strict=True)]
        np.testing.assert_allclose(here.jacobian, np.transpose(slopes), atol=1e-4)
        slopes = [(a.variances - b.variances) / (2 * step) for a, b in zip(ahead, behind, strict=True)]
        found = 2 * np.concatenate([here.gripper.covariances, here.object.covariances])[:, 0, 1:]
        np.testing.assert_allclose(found, np.transpose(slopes), atol=0.02)


def test_several_places_at_once_are_each_as_alone(scene, rng):
    points, at, seen, start = scene
    known = looked(points, at, start, seen)
    several = rng.uniform(-0.4, 0.4, (5, MOTORS))
    together, alone = known.at(several).apart, [known.at(each).apart for each in several]
    for found, expected in zip(together, zip(*alone, strict=True), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_what_is_expected_is_what_a_gaussian_would_be_given_all_that_was_seen(scene, rng, monkeypatch):
    """Against one joint Gaussian of looks, slopes from before and a new place, conditioned by brute force."""
    length = 1.3
    monkeypatch.setattr(GaussianProcess, "LENGTHS", np.array([length]))
    monkeypatch.setattr(GaussianProcess, "CHANGED", 1e-300)
    points, at, seen, start = scene
    known = looked(points, at, start, seen)
    length = np.full(MOTORS, length) if start is None else length * start.lengths[0]
    new = rng.uniform(-0.4, 0.4, MOTORS)
    expected = known.at(new)
    noise = (NOISE_PX * IMAGE_UNIT) ** 2
    for point in range(4):
        shown = at[seen[:, point]]
        values = np.array([points(each)[point] for each in shown])
        places = np.vstack([shown, new])
        joint = covariances(places, places, length) + np.diag([noise] * len(shown) + [0])
        if start is not None:
            error = start.variances[point] + np.diag(start.changes[point])
            across = with_slopes(places, start.registers, length)
            own = np.diag(GaussianProcess.SPREAD**2 / length**2) + error
            joint = np.block([[joint, across], [across.T, own]])
            order = [*range(len(shown)), *range(len(places), len(joint)), len(shown)]
            joint = joint[np.ix_(order, order)]
            values = np.vstack([values, start.jacobian[2 * point : 2 * point + 2].T])
        gain = np.linalg.solve(joint[:-1, :-1], joint[:-1, -1])
        np.testing.assert_allclose(expected.points[point], gain @ values, atol=1e-6)
        np.testing.assert_allclose(
            expected.variances[point], joint[-1, -1] - gain @ joint[:-1, -1], atol=1e-6
        )


def covariances(one, other, length):
    squares = np.square((one[:, None] - other) / length).sum(-1)
    return GaussianProcess.SPREAD**2 * np.exp(-squares / 2) + GaussianProcess.OFFSET**2


def with_slopes(places, where, length):
    """Covariances of coordinates at places and of slopes, by finite differences of `covariances`."""
    step = 1e-4
    ahead = covariances(places, where + step * np.eye(places.shape[1]), length)
    behind = covariances(places, where - step * np.eye(places.shape[1]), length)
    return (ahead - behind) / (2 * step)


@pytest.mark.parametrize("length", [0.3, 1.0, 3.0])
def test_points_are_as_far_off_as_it_expects_them_to_be(length):
    """Of functions of any smoothness, half lie within intervals for a half, and hardly any far out."""
    deviations = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        points, _ = wavy(rng, length, spread=2.0)
        walk = np.cumsum(rng.normal(scale=0.1, size=(9, MOTORS)), 0)
        expected = looked(points, walk[:-1]).at(walk[-1])
        off = points(walk[-1]) - expected.points
        deviations += list((off / np.sqrt(expected.variances)[:, None]).ravel())
    within = np.mean(np.abs(deviations) < 0.6745)
    assert 0.3 < within < 0.7
    assert np.mean(np.abs(deviations) > 4) < 0.03


def test_trials_tell_the_next_along_which_motors_points_are_smooth(rng):
    """And then less is known beforehand of what is far along a motor of short lengths."""
    start = None
    for _ in range(6):
        points, _ = wavy(rng, RELATIVE)
        start = looked(points, rng.uniform(-0.6, 0.6, (16, MOTORS)), start).slopes_for_next()
    assert (start.looks > 6 * 16).all()
    np.testing.assert_allclose(start.lengths.prod(1), 1)
    assert np.corrcoef(np.log(start.lengths[0]), np.log(RELATIVE))[0, 1] > 0.8
    known = looked(points, np.zeros((1, MOTORS)), start)
    unsure = [known.at(0.3 * way).gripper.variances.mean() for way in np.eye(MOTORS)]
    assert np.argmax(unsure) == 0
    assert np.argmin(unsure) == 1


def test_a_handful_of_looks_tells_nothing_of_one_motor_beside_another(rng):
    points, _ = wavy(rng, RELATIVE)
    slopes = looked(points, rng.uniform(-0.6, 0.6, (7, MOTORS))).slopes_for_next()
    np.testing.assert_array_equal(slopes.lengths, 1)
    unseen = np.tile([True, False, True, True], (12, 1))
    slopes = looked(points, rng.uniform(-0.6, 0.6, (12, MOTORS)), seen=unseen).slopes_for_next()
    np.testing.assert_array_equal(slopes.lengths[0], 1)
    assert (slopes.lengths[1] != 1).any()


def test_slopes_are_found_that_are_not_along_the_motors(rng):
    points, jacobian = wavy(rng, 2.0)
    at = np.vstack([np.zeros(MOTORS), rng.normal(scale=0.05, size=(MOTORS + 1, MOTORS))])
    here = looked(points, at).at(at[0])
    off = here.jacobian - jacobian(at[0])
    assert np.abs(off).max() < 0.25 * np.abs(here.jacobian).max()
    assert np.sqrt(np.mean(off**2)) < 3 * np.sqrt(here.slope_variances.diagonal(axis1=1, axis2=2).mean())


def test_an_object_that_does_not_move_is_known_to_be_still_whatever_the_gripper_does(rng):
    points, _ = wavy(rng, 0.5)

    def still(registers):
        return np.vstack([points(registers)[:2], [[0.3, 0.1], [0.2, -0.2]]])

    known = looked(still, rng.uniform(-0.2, 0.2, (6, MOTORS)))
    far = known.at(np.full(MOTORS, 0.4))
    gripper, object_ = np.sqrt(far.variances).reshape(2, 2).mean(1)
    assert object_ < gripper / 5
    np.testing.assert_allclose(far.points[2:], still(np.zeros(MOTORS))[2:], atol=4 * object_)


def test_slopes_from_before_save_looks_and_are_dropped_where_they_do_not_hold(rng):
    points, jacobian = wavy(rng, 2.0)
    at = np.array([[0.0] * MOTORS, [0.05, 0.0, 0.0, 0.0], [0.05, 0.05, 0.0, 0.0]])
    new = np.array([0.1, 0.05, -0.05, 0.1])
    before = jacobian(at[0])

    def off(start):
        return np.abs(looked(points, at, start).at(new).points - points(new)).max()

    assert off(Slopes.of(before)) < off(None) / 3
    assert off(Slopes.of(-before)) < 1.5 * off(None)


def test_a_look_that_misses_a_point_tells_nothing_of_it_and_all_of_the_others(rng):
    points, _ = wavy(rng, 1.0)
    at = rng.uniform(-0.3, 0.3, (6, MOTORS))
    seen = np.ones((6, 4), bool)
    seen[-1, 0] = False
    new = at[-1] + 0.05

    def mistaken(registers):
        off = np.zeros((4, 2))
        off[0] = 5.0 * (registers == at[-1]).all()
        return points(registers) + off

    known, blind = looked(points, at, seen=seen).at(new), looked(mistaken, at, seen=seen).at(new)
    np.testing.assert_allclose(known.points, blind.points)
    assert known.variances[0] > 2 * known.variances[1]


def test_looking_anew_keeps_slopes_and_forgets_where_points_were(rng):
    points, _ = wavy(rng, 2.0)
    known = looked(points, rng.uniform(-0.1, 0.1, (7, MOTORS)))

    def moved(registers):
        return points(registers) + 0.5

    here = np.zeros(MOTORS)
    last = known.at(here).jacobian
    known.look_anew(Observation(moved(here), np.ones(4, bool), here), NOISE_PX)
    near = np.full(MOTORS, 0.02)
    np.testing.assert_allclose(known.at(here).points, moved(here), atol=0.05)
    assert np.abs(known.at(near).jacobian - last).max() < np.abs(last).max()


def test_without_earlier_trials_it_is_as_if_there_had_been_none(rng, scene):
    points, at, seen, start = scene
    elsewhere, _ = wavy(rng, 1.0)
    before = looked(elsewhere, rng.uniform(-0.5, 0.5, (9, MOTORS))).gripper
    of_object = GaussianProcess.unknown(MOTORS + 4, MOTORS), points(at[0])[2:]
    known = SmoothPoints.remembered(before, of_object, NOISE_PX, start)
    alone = looked(points, at, start, seen)
    for registers, visible in zip(at, seen, strict=True):
        known.look(Observation(points(registers), visible, registers), NOISE_PX)
    new = rng.uniform(-0.5, 0.5, MOTORS)
    assert np.abs(known.at(new).points - alone.at(new).points).max() > 0.01
    known.forget_earlier_trials()
    assert not known.remembers
    for remembered, fresh in zip(known.at(new), alone.at(new), strict=True):
        for ours, theirs in zip(remembered, fresh, strict=True):
            np.testing.assert_allclose(ours, theirs)


def test_noise_that_is_found_out_late_holds_for_earlier_looks(rng):
    """As if it had been known from the first look on."""
    points, _ = wavy(rng, 1.0)
    at = rng.uniform(-0.3, 0.3, (6, MOTORS))
    late, always = SmoothPoints(MOTORS), SmoothPoints(MOTORS)
    for i, registers in enumerate(at):
        seen = points(registers) + rng.normal(scale=20 * IMAGE_UNIT, size=(4, 2))
        late.look(Observation(seen, np.ones(4, bool), registers), 20.0 if i >= 4 else NOISE_PX)
        always.look(Observation(seen, np.ones(4, bool), registers), 20.0)
    new = np.zeros(MOTORS)
    np.testing.assert_allclose(late.at(new).points, always.at(new).points)
    np.testing.assert_allclose(late.at(new).variances, always.at(new).variances)


@pytest.mark.parametrize("size", [1, 31, 32, 33, 150])
def test_lower_triangular_matrices_are_inverted(size, rng):
    factors = np.tril(rng.normal(size=(3, size, size)) / np.sqrt(size)) + 2 * np.eye(size)
    inverses = inverse(factors)
    np.testing.assert_allclose(inverses @ factors, np.tile(np.eye(size), (3, 1, 1)), atol=1e-10)
    assert not np.triu(inverses, 1).any()


def test_looks_that_contradict_each_other_make_no_length_vanish():
    """Such as those of cameras that were rolled again and again, each mapped a little wrongly."""
    rng = np.random.default_rng(0)
    places = np.repeat(rng.uniform(-1, 1, (30, 3)), 3, axis=0) + rng.normal(scale=1e-5, size=(90, 3))
    function = GaussianProcess.unknown(3, 3)
    for place in places:
        function = function.with_look(place, rng.uniform(-1, 1, (2, 2)), 4e-6, np.ones(2, bool))
    refitted = function.refitted()
    assert refitted.lengths.min() >= GaussianProcess.SHORTEST
    assert np.isfinite(refitted.at(places[0]).points).all()
