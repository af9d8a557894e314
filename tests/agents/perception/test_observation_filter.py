"""The filter of observations: made-up ones whose truth is known, and worlds that delay points."""

import contextlib
from dataclasses import dataclass, field

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.jacobian import Kalman
from agents.servo.perception import ObservationFilter
from agents.servo.trial import Findings, ServoTrial
from calfree_gym.image import IMAGE_UNIT

THERE = np.array([0.1, 0.0, 0.0])
PLACES = np.array([[-0.5, 0.1], [0.2, 0.3], [0.4, -0.4], [-0.1, -0.2]])
MOVED_PX = np.array([[20.0, 0.0], [0.0, 20.0], [-15.0, 15.0], [10.0, 10.0]])


def places(px):
    """Points (4, 2) so many pixels (4, 2) away from the four places."""
    return PLACES + np.asarray(px) * IMAGE_UNIT


def off_px(trusted, px):
    return np.abs(trusted.points - places(px)).max() / IMAGE_UNIT


def settled(filter_, observations, known=True):
    """The trusted observation after a motion from the places, and how many of `observations` it took."""
    home = Observation(PLACES, np.ones(4, bool), np.zeros(3))
    expected = PLACES + MOVED_PX * IMAGE_UNIT * known
    running = filter_.settle(observations[0], home, expected, np.full(4, 1.0 if known else 16.0))
    taken = 1
    try:
        words = next(running)
        while taken < len(observations):
            np.testing.assert_array_equal(words, np.zeros(3))
            taken += 1
            words = running.send(observations[taken - 1])
    except StopIteration as end:
        return end.value, taken
    raise AssertionError("it wants to observe more often")


@dataclass
class Prompt:
    """Makes observations after the motion, and a filter that has seen a motion come in time."""

    make: object
    filter: ObservationFilter = field(default_factory=ObservationFilter)

    def __post_init__(self):
        settled(self.filter, [self.make(places(MOVED_PX), -THERE)], known=False)

    def seen(self, px, visible=(True,) * 4):
        return self.make(places(px), THERE, visible)


@pytest.fixture
def prompt(observe):
    return Prompt(observe)


def test_an_observation_that_comes_out_as_predicted_is_taken_at_once(prompt):
    trusted, taken = settled(prompt.filter, [prompt.seen(MOVED_PX + 3.0)])
    assert taken == 1
    assert off_px(trusted, MOVED_PX + 3.0) < 1e-6


@pytest.mark.parametrize("point", range(4))
def test_a_mistaken_point_costs_one_more_observation_and_is_not_trusted(prompt, point):
    mistaken = MOVED_PX.copy()
    mistaken[point] += [150.0, -90.0]
    trusted, taken = settled(prompt.filter, [prompt.seen(mistaken), prompt.seen(MOVED_PX)])
    assert taken == 2
    assert off_px(trusted, MOVED_PX) < 1e-6
    assert not prompt.filter.inconsistent.any()


def test_what_two_observations_agree_on_is_trusted_however_inconsistent_with_the_prediction(prompt):
    elsewhere = MOVED_PX + np.array([[0.0, 0.0], [0.0, 0.0], [120.0, 0.0], [0.0, 0.0]])
    trusted, taken = settled(prompt.filter, [prompt.seen(elsewhere), prompt.seen(elsewhere + 1.0)])
    assert taken == 2
    assert off_px(trusted, elsewhere) <= 1.0
    assert prompt.filter.inconsistent.tolist() == [False, False, True, False]


def test_a_point_out_of_view_is_lost_after_two_observations(prompt):
    blind = (True, False, True, True)
    trusted, taken = settled(prompt.filter, [prompt.seen(MOVED_PX, blind)] * 2)
    assert taken == 2
    assert prompt.filter.lost.tolist() == [False, True, False, False]
    assert trusted.visible.tolist() == list(blind)
    assert off_px(trusted, MOVED_PX) < 1e-6  # where it is predicted to be


def test_where_points_are_missing_at_times_one_is_lost_after_more_observations(prompt):
    blind = (True, False, True, True)
    settled(prompt.filter, [prompt.seen(MOVED_PX, blind), prompt.seen(MOVED_PX)])
    settled(prompt.filter, [prompt.seen(MOVED_PX, blind)])
    assert not prompt.filter.lost.any()


def test_observations_that_come_late_are_waited_for(observe):
    before, after = observe(PLACES, THERE), observe(places(MOVED_PX), THERE)
    filter_ = ObservationFilter()
    trusted, taken = settled(filter_, [before, after], known=False)
    assert (filter_.latency.motions, taken) == (1, 2)
    assert off_px(trusted, MOVED_PX) < 1e-6
    assert settled(filter_, [before, after])[1] == 2


def test_late_observations_teach_no_noise(observe):
    """They differ from the next ones, where nothing moves, by the motion."""
    filter_, rng, noise_px = ObservationFilter(), np.random.default_rng(0), 0.7
    before = PLACES
    for motion in range(12):
        there, after = (motion + 1) * THERE, before + MOVED_PX * (-1) ** motion * IMAGE_UNIT
        seen = [
            observe(each + rng.normal(0, noise_px * IMAGE_UNIT, (4, 2)), there)
            for each in [before, *[after] * 9]
        ]
        running = filter_.settle(seen[0], observe(before, there - THERE), before, np.zeros(4))
        with contextlib.suppress(StopIteration):
            next(running)
            for later in seen[1:]:
                running.send(later)
        before = after
    assert filter_.latency.motions == 1
    assert filter_.noise.px == pytest.approx(noise_px, rel=0.35)


def test_a_point_that_was_never_seen_did_not_get_lost(observe):
    filter_ = ObservationFilter()
    blind = observe(PLACES, np.zeros(3), (True, True, False, True))
    running = filter_.first(blind)
    with contextlib.suppress(StopIteration):
        next(running)
        while True:
            running.send(blind)
    assert not filter_.lost.any()
    settled(filter_, [observe(places(MOVED_PX), THERE)] * 2, known=False)
    gone = observe(places(2 * MOVED_PX), 2 * THERE, (True, True, False, True))
    running = filter_.settle(gone, observe(places(MOVED_PX), THERE), places(2 * MOVED_PX), np.ones(4))
    with contextlib.suppress(StopIteration):
        next(running)
        while True:
            running.send(gone)
    assert filter_.lost.tolist() == [False, False, True, False]


@pytest.mark.parametrize(("noise_px", "mistaken"), [(0.7, 0.0), (5.0, 0.0), (20.0, 0.0), (0.7, 0.4)])
def test_noise_is_learned_from_observations_at_one_place(observe, noise_px, mistaken):
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        filter_, running = ObservationFilter(), None
        for _ in range(8):
            px = rng.normal(scale=noise_px, size=(4, 2))
            wrong = rng.random(4) < mistaken
            px[wrong] = rng.uniform(-250, 250, (4, 2))[wrong]
            seen = observe(places(px), THERE)
            try:
                if running is None:
                    running = filter_.settle(seen, observe(PLACES, THERE), PLACES, np.zeros(4))
                    next(running)
                else:
                    running.send(seen)
            except StopIteration:
                running = None
        found.append(filter_.noise.px)
    assert np.median(found) == pytest.approx(noise_px, rel=0.35)


@pytest.mark.parametrize(("noise_px", "wanted"), [(0.7, 0), (3.0, 1)])
def test_observations_are_made_to_learn_the_noise_where_points_miss_by_far_more_than_they_should(
    observe, noise_px, wanted
):
    rng, found = np.random.default_rng(0), []
    for _ in range(40):
        filter_, before = ObservationFilter(), observe(PLACES)
        settled(filter_, [observe(places(MOVED_PX), -THERE)], known=False)  # which comes in time
        for step in range(1, 4):
            px = MOVED_PX * step
            seen = observe(places(px + rng.normal(scale=noise_px, size=(4, 2))), step * THERE)
            with contextlib.suppress(StopIteration):
                next(filter_.settle(seen, before, places(px), np.full(4, 0.5)))
                raise AssertionError("it wants to observe again at once")
            before = seen
        found.append(filter_.needs_samples)
    assert np.mean(found) == pytest.approx(wanted, abs=0.1)


def test_nothing_is_learned_of_noise_where_nothing_is_seen(observe):
    filter_ = ObservationFilter()
    filter_.noise.px = 20.0
    for seen in (True, False):
        for _ in filter_.first(observe(PLACES, THERE, (seen,) * 4)):
            break
        assert filter_.needs_samples == seen


@pytest.mark.parametrize("motions", [0, 1])
def test_latency_is_found_out_in_wild_worlds(make_env, motions):
    found = []
    for seed in range(15):
        late = [{"at": {"trial": 0}, "do": {"type": "latency", "motions": 1}}] if motions else None
        env = make_env(perturbations=late)
        trial = ServoTrial(Observation.of(env.reset(seed=seed)[0]), Findings(Kalman(3)), 0.04, 16.0)
        for motor in trial.unmeasured():
            running = trial.test(motor)
            words = next(running, None)
            while words is not None:
                seen = Observation.of(env.step(words.astype(np.float32))[0])
                try:
                    words = running.send(seen)
                except StopIteration:
                    words = None
        found.append(trial.filter.latency.motions)
    assert np.mean(np.array(found) == motions) >= 0.9


def test_what_was_begun_with_is_not_looked_at_twice():
    """A servo under a knowledge base begins with what that one has begun with, hidden points included."""
    filter_, rng = ObservationFilter(), np.random.default_rng(0)

    def hidden():
        points = PLACES + rng.normal(0, 5 * IMAGE_UNIT, (4, 2))
        return Observation(points, np.array([True, True, True, False]), np.zeros(3))

    first = filter_.first(hidden())
    with contextlib.suppress(StopIteration):
        next(first)
        while True:
            first.send(hidden())
    begun = filter_._begun
    before = filter_.noise.arrays()[0]
    with pytest.raises(StopIteration) as end:
        next(filter_.first(begun))
    assert end.value.value is begun
    np.testing.assert_array_equal(filter_.noise.arrays()[0], before)
    assert before.all()


def test_a_file_of_a_version_that_kept_less_leaves_nothing_of_this_life():
    lived = ObservationFilter()
    lived.gating.counts, lived.home = np.array([9.0, 3.0]), np.zeros((2, 2))
    kept = lived.arrays()
    lived.restore({"returns": kept["returns"]})
    new = ObservationFilter().arrays()
    assert all(np.array_equal(value, new[name], equal_nan=True) for name, value in lived.arrays().items())
    lived.restore(kept)
    assert lived.gating.counts.tolist() == [9, 3]
