"""The filter of observations: made-up ones whose truth is known, and worlds that delay points."""

from itertools import count, repeat

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.jacobian import Kalman
from agents.servo.perception import ObservationFilter
from agents.servo.trial import Findings, ServoTrial
from calfree_gym.image import IMAGE_UNIT
from tests.agents.trials import carry_out

THERE = np.array([0.1, 0.0, 0.0])
PLACES = np.array([[-0.5, 0.1], [0.2, 0.3], [0.4, -0.4], [-0.1, -0.2]])
MOVED_PX = np.array([[20.0, 0.0], [0.0, 20.0], [-15.0, 15.0], [10.0, 10.0]])
BLIND = (True, False, True, True)


def places(px):
    """Points (4, 2) so many pixels (4, 2) away from the four places."""
    return PLACES + np.asarray(px) * IMAGE_UNIT


def off_px(trusted, px):
    return np.abs(trusted.points - places(px)).max() / IMAGE_UNIT


def seen(px, registers=THERE, visible=(True,) * 4):
    """An observation of points so many pixels (4, 2) away from the four places."""
    return Observation(places(px), np.array(visible), np.array(registers))


def shown(procedure, observations):
    """What a procedure is sent, until it ends; returns its words, and what it returned."""
    rest = iter(observations)
    return carry_out(procedure, lambda _: next(rest))


def settled(filter_, observations, known=True):
    """The trusted observation after a motion from the places, and how many of `observations` it took."""
    expected = PLACES + MOVED_PX * IMAGE_UNIT * known
    running = filter_.settle(
        observations[0], seen(0, np.zeros(3)), expected, np.full(4, 1.0 if known else 16.0)
    )
    words, trusted = shown(running, observations[1:])
    assert not words.any()
    assert trusted is not None, "it wants to observe more often"
    return trusted, 1 + len(words)


@pytest.fixture
def prompt():
    """A filter that has seen a motion come in time."""
    filter_ = ObservationFilter()
    settled(filter_, [seen(MOVED_PX, -THERE)], known=False)
    return filter_


def test_an_observation_that_comes_out_as_predicted_is_taken_at_once(prompt):
    trusted, taken = settled(prompt, [seen(MOVED_PX + 3.0)])
    assert taken == 1
    assert off_px(trusted, MOVED_PX + 3.0) < 1e-6


@pytest.mark.parametrize("point", range(4))
def test_a_mistaken_point_costs_one_more_observation_and_is_not_trusted(prompt, point):
    mistaken = MOVED_PX.copy()
    mistaken[point] += [150.0, -90.0]
    trusted, taken = settled(prompt, [seen(mistaken), seen(MOVED_PX)])
    assert taken == 2
    assert off_px(trusted, MOVED_PX) < 1e-6
    assert not prompt.inconsistent.any()


def test_what_two_observations_agree_on_is_trusted_however_inconsistent_with_the_prediction(prompt):
    elsewhere = MOVED_PX + np.array([[0.0, 0.0], [0.0, 0.0], [120.0, 0.0], [0.0, 0.0]])
    trusted, taken = settled(prompt, [seen(elsewhere), seen(elsewhere + 1.0)])
    assert taken == 2
    assert off_px(trusted, elsewhere) <= 1.0
    assert prompt.inconsistent.tolist() == [False, False, True, False]


def test_a_point_out_of_view_is_lost_after_two_observations(prompt):
    trusted, taken = settled(prompt, [seen(MOVED_PX, visible=BLIND)] * 2)
    assert taken == 2
    assert prompt.lost.tolist() == [False, True, False, False]
    assert trusted.visible.tolist() == list(BLIND)
    assert off_px(trusted, MOVED_PX) < 1e-6  # where it is predicted to be


def test_where_points_are_missing_at_times_one_is_lost_after_more_observations(prompt):
    settled(prompt, [seen(MOVED_PX, visible=BLIND), seen(MOVED_PX)])
    settled(prompt, [seen(MOVED_PX, visible=BLIND)])
    assert not prompt.lost.any()


def test_observations_that_come_late_are_waited_for():
    filter_, late = ObservationFilter(), [seen(0), seen(MOVED_PX)]
    trusted, taken = settled(filter_, late, known=False)
    assert (filter_.latency.motions, taken) == (1, 2)
    assert off_px(trusted, MOVED_PX) < 1e-6
    assert settled(filter_, late)[1] == 2


def test_late_observations_teach_no_noise():
    """They differ from the next ones, where nothing moves, by the motion."""
    filter_, rng, noise_px = ObservationFilter(), np.random.default_rng(0), 0.7
    before = np.zeros((4, 2))
    for motion in range(12):
        there, after = (motion + 1) * THERE, before + MOVED_PX * (-1) ** motion
        looks = [seen(each + rng.normal(0, noise_px, (4, 2)), there) for each in [before, *[after] * 9]]
        home = seen(before, there - THERE)
        shown(filter_.settle(looks[0], home, home.points, np.zeros(4)), looks[1:])
        before = after
    assert filter_.latency.motions == 1
    assert filter_.noise.px == pytest.approx(noise_px, rel=0.35)


def test_a_point_that_was_never_seen_did_not_get_lost():
    filter_, hidden = ObservationFilter(), (True, True, False, True)
    shown(filter_.first(seen(0, np.zeros(3), hidden)), repeat(seen(0, np.zeros(3), hidden)))
    assert not filter_.lost.any()
    settled(filter_, [seen(MOVED_PX)] * 2, known=False)
    gone = seen(2 * MOVED_PX, 2 * THERE, hidden)
    shown(filter_.settle(gone, seen(MOVED_PX), places(2 * MOVED_PX), np.ones(4)), repeat(gone))
    assert filter_.lost.tolist() == [False, False, True, False]


@pytest.mark.parametrize(("noise_px", "mistaken"), [(0.7, 0.0), (5.0, 0.0), (20.0, 0.0), (0.7, 0.4)])
def test_noise_is_learned_from_observations_at_one_place(noise_px, mistaken):
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        filter_, looks = ObservationFilter(), []
        for _ in range(8):
            px = rng.normal(scale=noise_px, size=(4, 2))
            wrong = rng.random(4) < mistaken
            px[wrong] = rng.uniform(-250, 250, (4, 2))[wrong]
            looks.append(seen(px))
        rest = iter(looks)
        for look in rest:
            carry_out(filter_.settle(look, seen(0), PLACES, np.zeros(4)), lambda _, rest=rest: next(rest))
        found.append(filter_.noise.px)
    assert np.median(found) == pytest.approx(noise_px, rel=0.35)


@pytest.mark.parametrize(("noise_px", "wanted"), [(0.7, 0), (3.0, 1)])
def test_observations_are_made_to_learn_the_noise_where_points_miss_by_far_more_than_they_should(
    noise_px, wanted
):
    rng, found = np.random.default_rng(0), []
    for _ in range(40):
        filter_, before = ObservationFilter(), seen(0, np.zeros(3))
        settled(filter_, [seen(MOVED_PX, -THERE)], known=False)  # which comes in time
        for step in range(1, 4):
            px = MOVED_PX * step
            now = seen(px + rng.normal(scale=noise_px, size=(4, 2)), step * THERE)
            assert not list(filter_.settle(now, before, places(px), np.full(4, 0.5))), "no look again at once"
            before = now
        found.append(filter_.needs_samples)
    assert np.mean(found) == pytest.approx(wanted, abs=0.1)


def test_nothing_is_learned_of_noise_where_nothing_is_seen():
    filter_ = ObservationFilter()
    filter_.noise.px = 20.0
    for visible in (True, False):
        next(filter_.first(seen(0, visible=(visible,) * 4)), None)
        assert filter_.needs_samples == visible


@pytest.mark.parametrize("motions", [0, 1])
def test_latency_is_found_out_in_wild_worlds(make_env, motions):
    found = []
    for seed in range(15):
        late = [{"at": {"trial": 0}, "do": {"type": "latency", "motions": 1}}] if motions else None
        env = make_env(perturbations=late)
        trial = ServoTrial(Observation.of(env.reset(seed=seed)[0]), Findings(Kalman(3)), 0.04, 16.0)
        for motor in trial.unmeasured():
            carry_out(
                trial.test(motor), lambda words, env=env: Observation.of(env.step(np.float32(words))[0])
            )
        found.append(trial.filter.latency.motions)
    assert np.mean(np.array(found) == motions) >= 0.9


def test_what_was_begun_with_is_not_looked_at_twice():
    """A servo under a knowledge base begins with what that one has begun with, hidden points included."""
    filter_, rng = ObservationFilter(), np.random.default_rng(0)
    looks = (seen(rng.normal(0, 5, (4, 2)), np.zeros(3), (True, True, True, False)) for _ in count())
    _, begun = shown(filter_.first(next(looks)), looks)
    before = filter_.noise.arrays()[0]
    words, again = shown(filter_.first(begun), looks)
    assert not len(words)
    assert again is begun
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


def test_counts_beyond_any_life_are_refused():
    with pytest.raises(ValueError, match=r"mistaken hold 1e\+300; allowed: .* at most 9.0072e\+15"):
        ObservationFilter().restore({"mistaken": np.full(2, 1e300)})
