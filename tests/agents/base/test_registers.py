"""Where motors stand, by words and by registers that are measured; and agents whose registers are."""

import warnings
from dataclasses import replace
from itertools import islice

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from agents.base.registers import Encoders, RegisterEstimate
from tests.agents.trials import motions_of

MOTORS = 3


class Motors:
    """Motors that execute words up to a greatest one, less a share, between stops."""

    def __init__(self, seed, noise=0.0, step=0.0, short=0.0, longest=1.0, stop=np.inf, encoders=None):
        self.random = np.random.default_rng(seed)
        self.noise, self.step, self.short, self.longest, self.stop = noise, step, short, longest, stop
        self.true = np.zeros(MOTORS)
        self.estimate = RegisterEstimate(self.measured(), encoders or Encoders())

    def measured(self):
        registers = self.true + self.noise * self.random.normal(size=MOTORS)
        return (np.round(registers / self.step) * self.step if self.step else registers).astype(np.float32)

    def send(self, wanted):
        """What is estimated after words are wanted (m,)."""
        words = self.estimate.words(np.asarray(wanted, float)).astype(np.float32)
        executed = np.clip(words, -self.longest, self.longest) * (1 - self.short)
        self.true = np.clip(self.true + executed, -self.stop, self.stop)
        return self.estimate.after(words, self.measured().astype(float))

    def wander(self, motions):
        """Errors (motions, m) of the estimate, after words of which a third is none."""
        errors = []
        for _ in range(motions):
            words = self.random.uniform(-0.3, 0.3, MOTORS) * (self.random.random(MOTORS) > 1 / 3)
            errors.append(self.send(words) - self.true)
        return np.array(errors)


@settings(max_examples=30)
@given(st.integers(0, 1000))
def test_exact_registers_are_taken_as_they_are(seed):
    assert np.abs(Motors(seed).wander(20)).max() < 1e-5


@pytest.mark.parametrize(
    ("errors", "most"),
    [
        ({"noise": 1e-3}, 0.5e-3),
        ({"noise": 5e-3}, 2.5e-3),
        ({"step": 0.01}, 0.01 / np.sqrt(12)),  # the error of what is rounded
        ({"short": 0.2}, 1e-4),
        ({"longest": 0.1}, 1e-4),
    ],
)
def test_it_is_hardly_more_off_than_registers_are_and_less_where_they_are_noisy(errors, most):
    off = np.concatenate([Motors(seed, **errors).wander(40)[10:] for seed in range(20)])
    assert np.sqrt(np.square(off).mean()) < most


@settings(max_examples=30)
@given(st.integers(0, 1000), st.sampled_from([{"noise": 3e-3}, {"step": 0.01}, {"short": 0.1}, {}]))
def test_a_motor_that_was_sent_nothing_or_stopped_stands_where_it_stood(seed, errors):
    motors = Motors(seed, stop=0.5, **errors)
    for _ in range(6):
        motors.send([0.1, -0.05, 0.0])
    before = motors.estimate.registers
    for _ in range(3):
        motors.send([0.0, -0.05, 0.0])
    assert (motors.estimate.registers == before)[[0, 2]].all()
    for _ in range(4):
        motors.send([0.4, 0.0, 0.0])
    at_stop = motors.estimate.registers
    rarely = 7 * errors.get("noise", 0.0)  # in 2 of the 1,001 seeds noise passes for a motion
    assert motors.send([0.4, 0.0, 0.0])[0] == pytest.approx(at_stop[0], abs=rarely)
    assert at_stop[0] == pytest.approx(0.5, abs=0.02)


def test_words_smaller_than_a_step_are_counted_though_registers_do_not_show_them():
    encoders = Encoders()
    Motors(0, step=0.01, encoders=encoders).wander(6)
    motors = Motors(1, step=0.01, encoders=encoders)  # the next trial
    for _ in range(12):
        estimate = motors.send([0.003, 0.0, -0.001])
        np.testing.assert_allclose(estimate, motors.true, atol=0.002)


@settings(max_examples=50)
@given(
    st.floats(1e-3, 0.1),
    st.lists(st.integers(-30, 30).filter(bool), min_size=6, max_size=30),
    st.booleans(),
)
def test_a_step_is_what_all_registers_are_multiples_of(step, multiples, stepped):
    steps = (
        np.array(multiples) if stepped else np.array(multiples) * np.sqrt(np.arange(1, len(multiples) + 1))
    )
    encoders = Encoders()
    encoders.read((step * steps).astype(np.float32).astype(float))
    common = np.gcd.reduce(multiples) * step
    if not stepped:
        assert encoders.step < step / 2
    elif np.abs(multiples).max() * step > 1.5 * common:
        assert encoders.step == pytest.approx(common, rel=1e-3)


def test_a_saved_agent_knows_its_encoders(tmp_path):
    env = gym.make("CalFree/Reach-v0", world="rough", dynamics="kinematic")
    env.reset(seed=4)
    agent = agents.make("paper_servo", env).learn(60)
    agent.save(tmp_path / "agent")
    fresh, loaded = agents.make("paper_servo", env), agents.make("paper_servo", env).load(tmp_path / "agent")
    saved, alike, other = (
        np.array([words for words, *_ in islice(motions_of(each, env, seed=5), 15)])
        for each in (agent, loaded, fresh)
    )
    np.testing.assert_array_equal(alike, saved)
    assert not np.array_equal(other, saved)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("other", [np.nan, 1.0, 1.0], "the share of words is nan"),
        ("other", [0.0, 1.0, 1.0], "the share of words is 0.0; it must be a number, 0.5 or more, at most 1"),
        ("other", [1.0, 0.0, 1.0], "the step of registers is 0.0"),
        ("other", [1.0, 1.0, np.inf], "the farthest register is inf"),
        ("other", [1.0, 1.0], "have shape"),
        ("resting", [np.nan], "not finite"),
        ("errors", ["0.1"], "of type <U3; they must be real numbers"),
        ("shares", [1j], "of type complex128"),
        ("in_a_row", [[1e300, 0.0]], r"hold 1e\+300; allowed: .* at most 1e\+100"),
    ],
)
def test_damaged_encoders_are_refused(name, value, said):
    arrays = Encoders().arrays()
    Encoders.of(arrays)
    with pytest.raises(ValueError, match=said):
        Encoders.of(arrays | {f"registers.{name}": np.array(value)})


def test_words_make_up_for_what_motors_usually_fall_short():
    motors = Motors(0, short=0.2)
    motors.wander(10)
    before = motors.true
    motors.send([0.3, -0.2, 0.1])
    np.testing.assert_allclose(motors.true - before, [0.3, -0.2, 0.1], rtol=0.02)


MEASURED = {
    "noise": {"register_noise": 1e-3},
    "step": {"register_step": 0.0015},
    "short": {"shortfall": 0.01},
    "limit": {"longest_motion": 0.1},
    "weak": {"word_gain": 0.25},
}


@pytest.mark.parametrize("errors", MEASURED.values(), ids=MEASURED)
@pytest.mark.parametrize("name", ["unified_servo", "paper_servo", "memory", "grid_table"])
def test_agents_reach_by_registers_that_are_measured(live, make_env, name, errors):
    motions = []
    for seed in (20_100, 20_101):
        drawn = make_env(world="wild")
        drawn.reset(seed=seed)
        env = make_env(world=replace(drawn.unwrapped.world, **errors))
        motions += live(name, env, seed, trials=3)[1]
    assert len(motions) == 6
    assert max(motions) < 40


def test_registers_near_zero_are_home_and_those_where_words_led_are_not(make_env):
    env = make_env(tolerance_px=1e-3)
    agent = agents.make("paper_servo", env)
    observation, _ = env.reset(seed=0)
    observation["observation"][4:] = [0.004, -0.006, 0.002]
    words, _ = agent.predict(observation)
    agent.predict(observation)  # home again
    observation["observation"][4:] += words
    with pytest.raises(ValueError, match="pass the state back"):
        agent.predict(observation)


@pytest.mark.parametrize("name", ["paper_servo", "unified_servo", "memory", "body_schema", "safe_start"])
def test_where_no_point_is_seen_nothing_moves_and_the_state_says_so_with_one_warning(name, make_env):
    env = make_env()
    agent, state = agents.make(name, env), None
    observation, _ = env.reset(seed=0)
    observation["observation"][:4] = 0
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for _ in range(5):
            words, state = agent.predict(observation, state)
            assert not words.any()
    assert "no point has been seen" in state[0].says
    assert len(told) == 1
    observation["observation"][:4] = 1
    words, state = agent.predict(observation, state)
    assert not state[0].says


@pytest.mark.filterwarnings("ignore:a trial of")
def test_where_no_motor_executes_anything_the_state_says_so(make_env):
    env = make_env()
    agent, state = agents.make("unified_servo", env), None
    observation, _ = env.reset(seed=0)
    for _ in range(40):
        _, state = agent.predict(observation, state)
    assert "no motor has moved" in state[0].says
