"""`safe_start`: small first motions, a leash that holds, and reasons where nothing can be done."""

from dataclasses import replace
from itertools import islice

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import agents
from agents.servo.perception import ObservationFilter
from agents.servo.safe.leash import Leash, LinearView, StraightWay, equal_units
from agents.servo.safe.safe_start import FirstMotions
from calfree_gym.image import IMAGE_UNIT, lengths_px
from tests.agents.linear_arm import LinearArm
from tests.agents.trials import carry_out, motions_of
from tests.arms.own import ARMS

WORDS = st.lists(st.floats(-1, 1), min_size=3, max_size=3)


class Noisy(LinearArm):
    """A linear arm whose points are seen with noise; beyond `seen_to` the first motor hides one."""

    def __init__(self, px_by_word, seen_to=np.inf, **bounds):
        super().__init__(px_by_word, **bounds)
        self._rng, self._seen_to = np.random.default_rng(0), seen_to

    def observed(self, words=0.0):
        seen = super().observed(words)
        noise = 0.5 * IMAGE_UNIT * self._rng.standard_normal((4, 2))
        visible = np.array([abs(self.registers[0]) <= self._seen_to, True, True, True])
        return replace(seen, points=seen.points + noise, visible=visible)


def first_motions(arm):
    """The motions made, and where motors then were."""
    motions, been = FirstMotions(arm.observed(), ObservationFilter()), []

    def observed(words):
        seen = arm.observed(words)
        been.append(seen.registers)
        return seen

    sent, _ = carry_out(motions.run(), observed)
    return motions, sent, np.array(been)


def view_of(arm, factor=1.0, variance=None):
    """A view of the arm that is right but for a factor, and as sure of each motor as is said."""
    view = LinearView(3)
    view.jacobian = factor * arm.jacobian
    if variance:
        view.variances = variance * np.eye(3)
    return view


def leash_of(now, view, most=0.5):
    return Leash(now, view, np.full(3, most), ObservationFilter(), np.ones(3))


def arm_with_object(ways, there, **bounds):
    """An arm whose gripper registers move by so many pixels (3, k), and an object that it meets `there`."""
    arm = LinearArm((1, 1, 1), **bounds)
    arm.jacobian = np.zeros((8, 3))
    arm.jacobian[: len(ways[0])] = IMAGE_UNIT * np.transpose(ways)
    arm.home = np.vstack([np.zeros((2, 2)), (arm.jacobian[:4] @ there).reshape(2, 2)])
    return arm


@pytest.mark.parametrize("strength", [(400, 400, 400), (8000, 60, 900), (50, 20_000, 300)])
def test_it_stands_still_then_moves_one_motor_at_a_time_the_smallest_word_first(strength):
    arm = Noisy(strength)
    motions, sent, been = first_motions(arm)
    assert not sent[: FirstMotions.LOOKS].any()
    moving = sent[FirstMotions.LOOKS :]
    assert ((moving != 0).sum(1) == 1).all()
    for motor in np.flatnonzero((moving != 0).any(0)):
        words = moving[moving[:, motor] != 0, motor]
        assert words[0] == FirstMotions.FIRST_WORD
        assert (np.sign(words) == np.resize([1, -1], len(words))).all(), "there and back"
        moved_px = np.abs(been[:, motor]).max() * strength[motor]
        smallest = FirstMotions.FIRST_WORD * strength[motor]
        most = FirstMotions.MOST_GROWTH * FirstMotions.CLEAR
        assert moved_px <= max(most, smallest), "no farther than needed"
        assert motions.tested[motor] > 0
    known = (moving != 0).any(0)
    np.testing.assert_allclose(
        motions.view.jacobian[:, known],
        arm.jacobian[:, known],
        atol=0.35 * np.abs(arm.jacobian).max(0)[known].max(),
    )


def test_a_point_that_is_lost_makes_it_go_back_and_on_by_half_the_other_way():
    _, sent, been = first_motions(Noisy((60, 400, 400), seen_to=0.03))
    moved = been[sent[:, 0] != 0, 0]
    lost = np.flatnonzero(np.abs(moved) > 0.03)
    assert len(lost)
    for each in lost:
        assert moved[each + 1] == pytest.approx(moved[each - 1]), "back to where all was seen"
        assert abs(moved[each + 2]) <= abs(moved[each]) / 2 + 1e-9
        assert moved[each + 2] * moved[each] < 0


def trial(agent, arm, motions):
    """A trial of an agent with a linear arm, up to so many motions: its words, and its state."""
    state, sent, seen = None, [], arm.observed()
    for _ in range(motions):
        raw = {
            "achieved_goal": seen.points[:2].ravel(),
            "desired_goal": seen.points[2:].ravel(),
            "observation": np.concatenate([seen.visible, seen.registers]),
        }
        words, state = agent.predict(raw, state)
        sent.append(words)
        seen = arm.observed(words)
    return np.array(sent), state


@pytest.mark.parametrize(
    ("arm", "why"),
    [
        (Noisy((400, 400, 400), lowest=0.0, highest=0.0), "no motor executes its smallest words"),
        (Noisy((0, 0, 0)), "no motor moves the gripper in the images"),
    ],
)
def test_where_nothing_can_be_done_it_says_why_and_stands_still(arm, why):
    agent = agents.make("safe_start", gym.make("CalFree/Reach-v0"))
    sent, state = trial(agent, arm, 60)
    assert why in agent.gave_up(state)[0]
    assert not sent[-5:].any()
    assert np.abs(sent).max() < 0.5


@given(WORDS, st.lists(WORDS, min_size=1, max_size=8))
@example([0.0, 0.0, 0.0], [[0.0, 0.0, 2.28e-124], [0.0, 0.0, 1.0]])  # a motion that shows nothing
@settings(max_examples=60)
def test_a_servo_stays_on_its_leash(start, asked):
    """Whatever words it sends, no motion is expected to move the images farther than the leash is long."""
    arm = LinearArm((400, 900, 200))
    arm.registers = 0.01 * np.array(start)
    seen = [arm.observed()]
    leash = leash_of(seen[0], view_of(arm), 0.05)

    def observed(words):
        seen.append(arm.observed(words))
        moved = lengths_px(seen[-1].points - seen[-2].points).max()
        assert moved <= leash.length_px + 1e-6
        assert leash.length_px <= Leash.MOST_PX
        return seen[-1]

    carry_out(leash.hold(np.array(words) for words in asked), observed)


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_the_leash_shrinks_where_images_do_otherwise_and_grows_where_they_do_as_expected(factor):
    arm, words = LinearArm((400, 400, 400)), np.array([0.05, 0.03, 0.0])
    before = arm.observed()
    leash = leash_of(before, view_of(arm, factor), 0.05)
    leash.learn(words, before, arm.observed(words))
    assert np.sign(leash.length_px - Leash.FIRST_PX) == factor


@pytest.mark.parametrize(("word", "learned"), [(1e-9, 0.0), (1e-4, 0.01), (0.1, 0.9)])
def test_it_learns_from_a_motion_as_much_as_that_shows_above_noise(word, learned):
    arm, view = LinearArm((400, 400, 400)), LinearView(3)
    view.jacobian = 1.5 * arm.jacobian
    before, words = arm.observed(), np.array([word, 0.0, 0.0])
    view.correct(words, before, arm.observed(words), noise_px=0.5)
    share = (1.5 * arm.jacobian - view.jacobian)[:, 0].sum() / (0.5 * arm.jacobian)[:, 0].sum()
    assert share == pytest.approx(learned, abs=0.1)
    np.testing.assert_array_equal(view.jacobian[:, 1:], 1.5 * arm.jacobian[:, 1:])


@pytest.mark.parametrize("px", [100.0, 40.0, 4.0])
def test_motions_near_the_object_are_short(px):
    arm = LinearArm((400, 400, 400))
    view, now = view_of(arm), arm.observed()
    points = np.vstack([now.points[:2], now.points[:2] + px * IMAGE_UNIT * np.eye(2)])
    allowed = leash_of(replace(now, points=points), view).allowed(np.array([0.5, 0.0, 0.0]), np.zeros(3))
    longest = min(Leash.FIRST_PX, max(Leash.OF_DISTANCE * px, Leash.NEAR_PX))
    assert view.moved_px(allowed) == pytest.approx(longest)


def test_it_goes_straight_in_registers_though_images_hardly_show_one_way():
    there = np.array([0.3, -0.2, 0.4])
    arm = arm_with_object([[300, 0, 0, 40], [0, 300, 40, 0], [0, 40, 0, 0]], there)
    view, places = view_of(arm, variance=1e-8), []
    leash = leash_of(arm.observed(), view)

    def observed(words):
        now = arm.observed(words)
        places.append(now.registers)
        return now

    carry_out(leash.hold(StraightWay(view, leash, np.ones(3)).go(leash.now), whole=False), observed)
    assert len(places) > 2, "on a leash"
    for place in places:
        assert np.linalg.norm(np.cross(place, there)) < 0.02 * np.linalg.norm(there) ** 2
    assert leash.now.distance_px < StraightWay.NEAR_PX


def test_what_the_leash_holds_back_is_no_stop():
    bound = np.array([1.0, 1.0, 0.03])
    arm = arm_with_object([[300, 0], [0, 300], [150, 0]], [0.3, 0.3, 0.0], highest=bound)
    view = view_of(arm, variance=1e-8)
    leash = leash_of(arm.observed(), view)
    carry_out(leash.hold(StraightWay(view, leash, np.ones(3)).go(leash.now), whole=False), arm.observed)
    assert leash.stops.found[1].tolist() == [np.inf, np.inf, 0.03]
    assert leash.now.distance_px < StraightWay.NEAR_PX


def test_where_a_motion_lost_a_point_the_leash_lets_it_back_at_once():
    arm = LinearArm((300, 300, 300))
    leash = leash_of(arm.observed(), view_of(arm))
    before, words = leash.now, leash.allowed(np.array([0.2, 0.1, 0.0]), np.zeros(3))
    after = arm.observed(words)
    leash.learn(words, before, replace(after, visible=np.array([False, True, True, True])))
    np.testing.assert_allclose(leash.allowed(-words, after.registers), -words)
    farther = leash.allowed(-2 * words, after.registers)
    assert np.abs(farther).max() < np.abs(words).max(), "beyond that it is as short as after any surprise"


def test_it_goes_back_from_what_it_met_and_then_nowhere_in_that_direction():
    arm = LinearArm((300, 300, 300))
    view = view_of(arm, variance=1e-8)
    leash = leash_of(arm.observed(), view)
    run = StraightWay(view, leash, np.ones(3)).go(leash.now)
    straight = next(run)
    met = arm.observed(0.2 * straight)
    leash.contacts += 1
    back = run.send(met)
    np.testing.assert_allclose(met.registers + back, 0.0, atol=1e-12)
    along = run.send(arm.observed(back))
    assert np.linalg.norm(along) > 1e-3
    assert along @ straight < 1e-9


def test_it_does_not_trust_what_noise_may_tell_of_a_motor():
    arm = LinearArm((1, 1, 1))
    arm.home = 0.003 * arm.home
    arm.jacobian = np.zeros((8, 3))
    arm.jacobian[[0, 1, 2], [0, 1, 2]] = IMAGE_UNIT * np.array([300.0, 300.0, 1.0])
    view, unsure = LinearView(3), LinearView(3)
    view.jacobian = unsure.jacobian = arm.jacobian
    unsure.variances = (5 * IMAGE_UNIT) ** 2 * np.eye(3)
    now = arm.observed()
    trusted, doubted = (
        StraightWay(each, leash_of(now, each), np.ones(3)).words(now) for each in (view, unsure)
    )
    assert abs(doubted[2]) < 0.1 * abs(trusted[2])
    np.testing.assert_allclose(doubted[:2], trusted[:2], rtol=0.01)


def test_units_make_all_motors_alike():
    arm = LinearArm((4000, 900, 700))
    units = equal_units(arm.jacobian)
    moved = lengths_px((arm.jacobian * units).reshape(4, 2, 3).swapaxes(1, 2)).max(0)
    np.testing.assert_allclose(moved, moved[0])
    arm.jacobian[:, 1] = 0
    assert equal_units(arm.jacobian)[1] == units[[0, 2]].mean()


def test_no_joint_goes_far_in_the_first_motion_and_nothing_is_harmed():
    env = gym.make("CalFree/SafeReach-v0")
    for seed in range(100, 110):
        trial = motions_of(agents.make("safe_start", env), env, seed=seed)
        words, _, _, infos = zip(*islice(trial, 1 + FirstMotions.LOOKS), strict=True)
        assert max(info["joint_travel"] for info in infos) < np.radians(10)
        assert not any(info["harmed"] for info in infos)
        assert np.any(words[-1])


@pytest.mark.parametrize("servo", ["unified_servo", "jacobian_servo"])
def test_it_reaches_where_nothing_can_be_touched_too_and_remembers(servo, tmp_path):
    env = gym.make("CalFree/Reach-v0", world="nominal", dynamics="kinematic")
    env.reset(seed=1)
    agent = agents.make("safe_start", env, servo=servo).learn(90)
    assert agent.slopes is not None
    agent.save(tmp_path / "safe")
    other = agents.make("safe_start", env, servo=servo).load(tmp_path / "safe")
    np.testing.assert_array_equal(other.units, agent.units)
    assert any(arrived for *_, arrived, _ in islice(motions_of(other, env, seed=5), 40))


def test_in_a_later_trial_its_servo_goes_on_at_once_as_it_would_without_a_leash(make_env):
    env = make_env("stand", arm=ARMS["redundant"])
    agent, servo = agents.make("safe_start", env), agents.make("unified_servo", env)
    env.reset(seed=2)
    agent.learn(120)
    servo.slopes, servo.filter = agent.slopes, agent.filter
    first, _ = env.reset(seed=3)
    (words, _), (asked, _) = (each.predict(first) for each in (agent, servo))
    assert 0 < np.abs(words).max() < 1
    np.testing.assert_allclose(words * (asked @ asked), asked * (words @ asked), atol=1e-6)


def test_motors_that_may_rest_are_not_taken_for_strong_ones(make_env):
    env = make_env("stand", arm=ARMS["redundant"])
    agent = agents.make("safe_start", env)
    env.reset(seed=2)
    sent = np.array([words for words, *_ in motions_of(agent, env)])
    rested = ~sent[np.count_nonzero(sent, axis=1) == 1].any(0)
    assert rested.any()
    env.reset(seed=2)
    agent.learn(120)
    columns = (agent.slopes.jacobian / agent.units).reshape(4, 2, -1).swapaxes(1, 2)
    strengths = lengths_px(columns).max(0)
    assert strengths[rested].max() < strengths[~rested].max()


class Been(gym.Wrapper):
    """Notes how far each motor was told to have been in each trial."""

    def reset(self, **arguments):
        if not hasattr(self, "trials"):
            self.trials = []
        self.trials.append(np.zeros(self.action_space.shape))
        return self.env.reset(**arguments)

    def step(self, action):
        step = self.env.step(action)
        np.maximum(self.trials[-1], np.abs(step[0]["observation"][4:]), out=self.trials[-1])
        return step


def test_how_far_motors_have_been_is_remembered(make_env):
    """So none begins with the smallest word anew, those too that rested in the first motions."""
    env = Been(make_env("stand", arm=ARMS["redundant"]))
    env.reset(seed=2)
    agent = agents.make("safe_start", env).learn(200, lambda _: len(env.trials) < 5)
    been = np.max(env.trials[:-1], axis=0)
    np.testing.assert_allclose(agent.tested, np.maximum(been, FirstMotions.FIRST_WORD))


def test_units_of_a_servo_become_words():
    arm, units = LinearArm((400, 400, 400)), np.array([0.5, 2.0, 1.0])
    leash = Leash(arm.observed(), view_of(arm), np.full(3, 0.5), ObservationFilter(), units)
    asked = np.array([0.004, 0.002, 0.0])
    sent, _ = carry_out(leash.hold(each for each in [asked]), arm.observed)
    np.testing.assert_allclose(np.sum(sent, 0), asked * units)


def test_a_motor_that_stops_before_it_shows_is_tried_the_other_way():
    motions, _, _ = first_motions(Noisy((60, 400, 400), highest=0.005))
    assert motions.tested[0] > 0.02
