"""The environment for a robot of one's own, `examples/own_robot.py`: what it asks of her functions."""

import re
import signal
import threading
import time
import traceback

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from calfree_gym.picture_reach import LostMarkError
from tests.calfree_gym.environments import example
from tests.test_examples import output

own_robot = example("own_robot")
DARK = np.zeros((48, 64, 3), np.uint8)


class Seeing:
    """A tracker that sees all marks, but for those that are hidden, by their numbers."""

    def __init__(self):
        self.hidden = []

    def __call__(self, left, right, moved=False):
        return np.zeros((4, 2)), ~np.isin(np.arange(4), self.hidden)

    def reset(self):
        pass


class Arm:
    """Goes where it is sent, with errors, and shows nothing; `gives` replaces what a function gives."""

    def __init__(self, motors=5, noise=0.0, step=0.0, shortfall=0.0, stop=1.0):
        self.gives, self.sent, self.at = {}, [], np.zeros(motors)
        self.noise, self.step, self.shortfall, self.stop = noise, step, shortfall, stop
        self.rng = np.random.default_rng(0)

    def go_to(self, registers):
        self.sent.append(registers)
        if "go_to" in self.gives:
            return self.gives["go_to"]()
        self.at = self.at + (1 - self.shortfall) * (registers - self.at)
        self.at = np.clip(self.at, -self.stop, self.stop)
        told = self.at + self.noise * self.rng.normal(size=len(self.at))
        return np.round(told / self.step) * self.step if self.step else told

    def take_pictures(self):
        return self.gives["take_pictures"]() if "take_pictures" in self.gives else (DARK, DARK)

    def place_object(self):
        if "place_object" in self.gives:
            self.gives["place_object"]()


def made(arm=None, **arguments):
    arm = arm or Arm()
    arguments = {"marks": Seeing()} | arguments
    env = own_robot.OwnRobot(len(arm.at), arm.go_to, arm.take_pictures, arm.place_object, **arguments)
    return arm, env


def moved(env, motions=200, size=0.1):
    """After random words, and a way home now and then."""
    rng = np.random.default_rng(1)
    for motion in range(motions):
        if motion % 20 == 0:
            env.reset()
        env.step(rng.uniform(-size, size, env.action_space.shape))
    return env.register_errors


def test_it_is_an_environment():
    check_env(made()[1], skip_render_check=True)


FIVE = "allowed: 5 finite numbers within -1.1 to 1.1"
PICTURES = "allowed: two RGB images, arrays (h, w, 3) of uint8"


@pytest.mark.parametrize(
    ("function", "gives", "error", "said"),
    [
        ("go_to", np.zeros(3), ValueError, f"go_to told array([0., 0., 0.]); {FIVE}"),
        ("go_to", None, ValueError, f"go_to told None; {FIVE}"),
        ("go_to", [0, 0, np.nan, 0, 0], ValueError, f"go_to told [0, 0, nan, 0, 0]; {FIVE}"),
        ("go_to", [[0], 1], ValueError, f"go_to told [[0], 1]; {FIVE}"),
        ("go_to", [0, 0, 0, 0, 90], ValueError, f"go_to told [0, 0, 0, 0, 90]; {FIVE}"),
        ("take_pictures", None, "lost", f"take_pictures gave None as the left picture; {PICTURES}"),
        ("take_pictures", (DARK, None), "lost", f"gave None as the right picture; {PICTURES}"),
        ("take_pictures", OSError("unplugged"), "lost", "take_pictures failed: OSError('unplugged')"),
        ("take_pictures", (DARK,), ValueError, f"take_pictures gave ({DARK!r:.20}"),
        ("take_pictures", (DARK, DARK[..., 0]), ValueError, f"a right picture (48, 64) of uint8; {PICTURES}"),
        ("take_pictures", (DARK / 255, DARK), ValueError, "a left picture (48, 64, 3) of float64"),
        ("go_to", OSError("no bus"), OSError, "no bus"),
    ],
)
def test_what_a_function_gives_is_checked_before_anything_moves_further(function, gives, error, said):
    def give():
        if isinstance(gives, Exception):
            raise gives
        return gives

    error = own_robot.LostCameraError if error == "lost" else error
    arm, env = made()
    env.reset()
    arm.gives[function] = give
    before = len(arm.sent)
    with pytest.raises(error, match=re.escape(said)):
        env.step(np.full(5, 0.1))
    assert len(arm.sent) == before + 1
    with pytest.raises(gym.error.ResetNeeded, match="an error since"):
        env.step(np.full(5, 0.1))
    with pytest.raises(error, match=re.escape(said)):
        env.reset()
    assert len(arm.sent) == before + 1 + (function == "go_to"), "a lost camera is told before the way home"
    del arm.gives[function]
    env.reset()
    env.step(np.full(5, 0.1))


def test_a_motion_that_failed_on_its_way_is_ended_before_the_way_home():
    arm, env = made(greatest_motion=0.05)
    env.reset()
    for _ in range(4):
        env.step(np.full(5, 0.05))

    def gives():
        arm.at = arm.sent[-1]
        raise OSError("no bus")

    arm.gives["go_to"] = gives
    for again in (lambda: env.step(np.full(5, 0.05)), env.reset, env.reset):
        with pytest.raises(OSError, match="no bus"):
            again()
    del arm.gives["go_to"]
    env.reset()
    assert np.abs(np.diff(arm.sent, axis=0)).max() < 0.05 + 1e-9
    np.testing.assert_allclose(arm.at, 0, atol=1e-9)


def test_a_robot_that_does_not_come_home_is_told_before_the_object_is_placed():
    arm, env = made()
    env.reset()
    env.step(np.full(5, 0.4))
    placed = []
    arm.gives |= {"go_to": lambda: arm.at, "place_object": lambda: placed.append(1)}
    with pytest.raises(RuntimeError, match=r"does not come home: its registers are \[0.4"):
        env.reset()
    assert not placed


@pytest.mark.parametrize("words", [np.zeros(3), np.full(5, np.nan), None, ["a"] * 5])
def test_words_are_checked_before_anything_moves(words):
    arm, env = made()
    with pytest.raises(gym.error.ResetNeeded, match="reset first"):
        env.step(np.zeros(5))
    env.reset()
    before = len(arm.sent)
    with pytest.raises(ValueError, match=r"the action holds .*allowed: 5 finite numbers$"):
        env.step(words)
    assert len(arm.sent) == before


@pytest.fixture
def ctrl_c():
    """Ctrl-C is heard, also in jobs in the background, which ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_comes_through_to_who_places_the_object(ctrl_c):
    arm, env = made()
    arm.gives["place_object"] = lambda: signal.raise_signal(signal.SIGINT) or time.sleep(5)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt) as raised:
        env.reset()
    assert time.monotonic() - began < 3
    assert "place_object" in [frame.name for frame in traceback.extract_tb(raised.tb)]


@pytest.mark.parametrize("function", ["go_to", "take_pictures"])
def test_a_function_that_hangs_is_named_and_called_no_more(function):
    arm, env = made(patience=0.2)
    go_on = threading.Event()
    arm.gives["place_object"] = lambda: go_on.wait(0.3)  # which may take as long as it takes
    env.reset()
    arm.gives.clear()
    arm.gives[function] = go_on.wait
    for again in (lambda: env.step(np.full(5, 0.1)), env.reset):
        with pytest.raises(
            TimeoutError, match=rf"{function} has not ended after 0.2 s|{function} still hangs"
        ):
            again()
    assert len(arm.sent) == 2
    go_on.set()


def test_no_motor_goes_farther_at_once_than_it_may():
    arm, env = made(greatest_motion=0.125)
    env.reset()
    for _ in range(4):
        observation, *_ = env.step(np.array([1, -1, 0.1, 0, 0.5], np.float32))
    np.testing.assert_allclose(observation["observation"][4:], [0.5, -0.5, 0.4, 0, 0.5], atol=1e-6)
    env.reset()
    ways = np.diff(arm.sent, axis=0)
    assert np.abs(ways).max() == pytest.approx(0.125)
    assert not arm.at.any()


def test_home_is_told_as_it_was_measured_and_words_lead_on_from_there():
    arm, env = made(Arm(noise=0.001))
    told = env.reset()[0]["observation"][4:]
    assert 0 < np.abs(told).max() < 0.01
    assert not arm.sent[-1].any()
    env.step(np.full(5, 0.1))
    np.testing.assert_allclose(arm.sent[-1], told + 0.1, atol=1e-6)


def test_a_gripper_that_is_never_seen_is_named_after_three_motions():
    arm, env = made(marks=(tracker := Seeing()))
    tracker.hidden = [0]
    env.reset()
    for _ in range(2):
        env.step(np.full(5, 0.1))
    before = len(arm.sent)
    with pytest.raises(LostMarkError, match="for 3 motions the gripper in camera left is not seen"):
        env.step(np.full(5, 0.1))
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.full(5, 0.1))
    assert len(arm.sent) == before + 1
    tracker.hidden = []
    env.reset()
    env.step(np.full(5, 0.1))


def test_a_mark_may_be_hidden_elsewhere_but_not_where_it_was_seen():
    _, env = made(marks=(tracker := Seeing()))
    env.reset()
    tracker.hidden = [1, 3]
    for _ in range(5):
        env.step(np.full(5, 0.1))
    with pytest.raises(LostMarkError, match="the gripper in camera right"):
        env.step(np.full(5, -0.5))


@pytest.mark.parametrize("wrong", [0, 1.5, np.nan, "a", None, True])
def test_a_greatest_motion_that_is_none_is_refused(wrong):
    with pytest.raises(ValueError, match=f"greatest_motion is {wrong!r}; it must be a number above 0"):
        made(greatest_motion=wrong)


@pytest.mark.parametrize(("name", "wrong"), [("motors", 0), ("motors", 2.5), ("most_motions", 0)])
def test_a_count_that_is_none_is_refused(name, wrong):
    functions = dict.fromkeys(("go_to", "take_pictures", "place_object"), print)
    with pytest.raises(ValueError, match=f"{name} is {wrong}; it must be a whole number"):
        own_robot.OwnRobot(**{"motors": 5, **functions, name: wrong})


@pytest.mark.parametrize("size", [0.1, 0.5])
@pytest.mark.parametrize(
    ("noise", "step", "shortfall"),
    [(0, 0, 0), (0.002, 0, 0), (0, 0.0015, 0), (0, 2 * np.pi / 4096, 0.02), (0.0005, 0.0015, 0.05)],
)
def test_errors_of_registers_are_found(noise, step, shortfall, size):
    """Against those that the arm has: of steps 0.29 of one, as those of a uniform distribution."""
    _, env = made(Arm(noise=noise, step=step, shortfall=shortfall, stop=0.6))
    found = moved(env, size=size)
    spread = np.hypot(noise, step / np.sqrt(12))
    np.testing.assert_allclose(found.noise, spread, rtol=0.6, atol=1e-9)
    np.testing.assert_allclose(found.step, step, rtol=1e-6)
    np.testing.assert_allclose(found.shortfall, shortfall, atol=3 * own_robot.UNSURE)


def test_a_robot_that_tells_its_registers_as_real_ones_do_is_learned(opengl):
    robot = ("--registers", "--register-noise", "0.001", "--register-step", "0.0015", "--shortfall", "0.01")
    line, told = output("own_robot.py", "--motions", "40", *robot).splitlines()
    motions = [int(each) for each in line.partition(":")[2].split()]
    assert len(motions) >= 3
    assert max(motions[:3]) <= 15
    assert told.startswith("registers: RegisterErrors(noise=array([")


def test_a_tolerance_that_cannot_be_is_refused():
    with pytest.raises(ValueError, match="tolerance_px is nan"):
        made(tolerance_px=np.nan)
