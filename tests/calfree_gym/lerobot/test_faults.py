"""Every fault at every moment of a motion: it is ignored, tolerated for three motions, or the arm holds."""

import itertools
import re
from typing import ClassVar

import cv2
import gymnasium as gym
import numpy as np
import pytest

from calfree_gym.lerobot import ArmError
from calfree_gym.lerobot.environment import SLOWLY
from calfree_gym.lerobot.frames import FROZEN_S
from calfree_gym.lerobot.motors import AHEAD, JITTER_S, RATE, Motors
from tests.calfree_gym.lerobot.fake_so101 import NO_PACKET, OVERLOAD, FakeSO101
from tests.calfree_gym.lerobot.so101 import MOTORS

WORDS = np.array([0.2, 0.15, -0.2, 0.1, 0.1], np.float32)
"""A motion there and back loses nothing from view."""
MOMENTS = ("streaming", "looking", pytest.param("settling", marks=pytest.mark.slow))


def there_and_back(env, motions, words=WORDS):
    for motion in range(motions):
        env.step(words * (-1) ** motion)


def left(robot):
    return robot.cameras["left"]


def setting(part, **values):
    """A fault, by attributes of a part of the robot."""
    return lambda robot: vars(part(robot)).update(values)


def raising(error):
    def fault(robot):
        raise error

    return fault


def jammed(robot):
    robot.jam("elbow_flex")


lost, frozen, copies = (
    setting(left, losing=4),
    setting(left, frozen=True),
    setting(left, frozen=True, copies=True),
)
unplugged = setting(lambda robot: robot.cameras["right"], unplugged=True)
no_packet, overload = (setting(lambda robot: robot.bus, error=error) for error in (NO_PACKET, OVERLOAD))
hidden, dark, swapped = (
    lambda robot: robot.hidden.add("object"),
    lambda robot: robot.hidden.update({"gripper_1", "gripper_2", "object"}),
    setting(lambda robot: robot, swapped=True),
)
interrupted = raising(KeyboardInterrupt("Ctrl-C"))
broken = raising(ZeroDivisionError("in a function of the user's"))


def mend(robot):
    robot.bus.error = None
    robot.swapped = False
    robot.hidden.clear()
    robot.free("elbow_flex")
    for camera in robot.cameras.values():
        camera.unplugged = camera.frozen = camera.copies = False
    robot.sleep(0.5)


@pytest.mark.parametrize("moment", MOMENTS)
def test_dropped_frames_are_ignored(bench, moment):
    seen, happened = [], []
    for fault in (happened.append, lost):
        each = bench()
        each.env.reset()
        each.then(moment, lambda fault=fault, robot=each.robot: fault(robot))
        each.env.step(WORDS)
        seen.append(each.env.look)
        np.testing.assert_allclose(each.env.registers, WORDS, atol=1e-6)
    assert happened
    np.testing.assert_array_equal(seen[0].visible, seen[1].visible)
    np.testing.assert_allclose(256 * seen[0].points, 256 * seen[1].points, atol=2)


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize(
    ("fault", "error", "said"),
    [
        (unplugged, ArmError, "OpenCVCamera(right) latest frame is too old"),
        (frozen, ArmError, "camera left has shown no new picture for 1 s"),
        (copies, ArmError, "camera left has shown no new picture for 1 s"),
        (no_packet, ArmError, "There is no status packet!"),
        (overload, ArmError, "Overload error!"),
        (interrupted, KeyboardInterrupt, "Ctrl-C"),
        (broken, ZeroDivisionError, "in a function of the user's"),
    ],
)
def test_the_arm_holds_at_once(ready, fault, error, said, moment):
    robot, env = ready.robot, ready.env
    when = []

    def happens():
        when.append((robot.clock(), len(ready.actions)))
        fault(robot)

    ready.then(moment, happens)
    with pytest.raises(error, match=re.escape(said)) as raised:
        there_and_back(env, 2 if fault is copies else 1)
    ((began, ticks),) = when
    assert robot.clock() - began < 2 * FROZEN_S + 1
    if fault not in (frozen, copies):
        assert len(ready.actions) <= ticks + 1, "nothing more is sent"
    assert "The arm holds" in "".join([str(raised.value), *getattr(raised.value, "__notes__", [])])
    stood, sent = robot.plant.angles.copy(), len(ready.actions)
    robot.sleep(2.0)
    assert np.degrees(np.abs(robot.plant.angles - stood)).max() < AHEAD
    assert np.abs(robot.goals_ahead()).max() < AHEAD
    assert robot.plant.powered
    with pytest.raises(gym.error.ResetNeeded, match="an error since"):
        env.step(WORDS)
    assert len(ready.actions) == sent
    mend(robot)
    observation, _ = env.reset()
    assert not observation["observation"][4:].any()
    env.step(WORDS)


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (hidden, "the object in camera left is not seen"),
        (dark, "the gripper in camera left is not seen"),
        (swapped, "camera left shows what the other one has shown"),
        (jammed, "motor elbow_flex stays back"),
    ],
)
def test_what_an_agent_may_put_right_is_tolerated_for_three_motions(ready, fault, said, moment):
    env = ready.env
    ready.then(moment, lambda: fault(ready.robot))
    env.step(WORDS)
    for _ in range(3):
        env.step(np.zeros(5))
    motions = env.motions
    with pytest.raises(ArmError, match=f"for 3 motions {said}") as raised:
        there_and_back(env, 5, -WORDS)
    assert env.motions >= motions + 2
    pictures = [cv2.imread(str(file)) for file in raised.value.pictures]
    assert [picture.shape for picture in pictures] == [(480, 640, 3)] * 2
    mend(ready.robot)
    env.reset()


@pytest.mark.parametrize("moment", MOMENTS)
def test_what_is_over_after_two_motions_is_no_error(ready, moment):
    env = ready.env
    for fault in (hidden, swapped):
        ready.then(moment, lambda fault=fault: fault(ready.robot))
        env.step(WORDS)
        env.step(-WORDS)
        mend(ready.robot)
        observation, *_ = env.step(np.zeros(5))
        assert observation["observation"][:4].all()


def test_pictures_of_the_other_camera_show_nothing(bench):
    bench = bench()
    env = bench.env
    first, _ = env.reset()
    bench.robot.mixed = 0.4
    points, seen = [], []
    for _ in range(12):
        observation, *_ = env.step(np.zeros(5))
        points.append(np.concatenate([observation["achieved_goal"], observation["desired_goal"]]))
        seen.append(observation["observation"][:4] > 0)
    assert 0.2 < np.mean(seen) < 1
    at = np.concatenate([first["achieved_goal"], first["desired_goal"]])
    assert 256 * np.abs(points - at).max() < 3


def test_a_mark_that_is_not_seen_from_home_is_told_before_anything_moves(ready):
    ready.actions.clear()
    hidden(ready.robot)
    said = "object in camera left is not seen; the object in camera right is not seen"
    with pytest.warns(UserWarning, match=f"{said}: place"), pytest.raises(ArmError, match=said):
        ready.env.reset()
    assert len({tuple(action.values()) for action in ready.actions}) == 1


def test_an_object_that_is_not_seen_is_placed_anew(bench):
    def place():
        robot.hidden = {"object"} - robot.hidden
        robot.place_object()

    robot = FakeSO101()
    with pytest.warns(UserWarning, match="place the object anew"):
        observation, _ = bench(robot=robot, place_object=place).env.reset()
    assert observation["observation"][:4].all()


def steps(actions):
    """How far goals (n, m) of all motors go at once, in degrees."""
    return np.abs(np.diff([list(action.values()) for action in actions], axis=0))


@pytest.mark.parametrize("wrong", [170.0, -360.0, 40.0, np.nan])
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_wrong_reading_moves_nothing(ready, moment, wrong, monkeypatch):
    robot, read = ready.robot, ready.robot.get_observation

    def misread():
        monkeypatch.setattr(robot, "get_observation", read)
        seen = read()
        return seen | {"elbow_flex.pos": seen["elbow_flex.pos"] + wrong}

    ready.then(moment, lambda: monkeypatch.setattr(robot, "get_observation", misread))
    ready.actions.clear()
    with pytest.raises(
        ArmError, match=f"while {moment}, motor elbow_flex says that it stands at .* right after"
    ):
        ready.env.step(WORDS)
    assert steps(ready.actions).max() <= 60 / RATE + 1e-9
    robot.sleep(1.0)
    assert np.abs(robot.goals_ahead()).max() < AHEAD
    ready.env.reset()


def test_where_the_arm_fell_without_power_it_goes_home_slowly_from_there(ready):
    robot, env = ready.robot, ready.env
    env.step(WORDS)
    robot.bus.error = OVERLOAD
    with pytest.raises(ArmError, match="Overload"):
        env.step(WORDS)
    robot.plant.powered = False
    before = robot.plant.angles.copy()
    robot.sleep(3.0)
    assert np.degrees(np.abs(robot.plant.angles - before)).max() > AHEAD, "it has fallen"
    robot.bus.error, robot.plant.powered = None, True
    there = list(robot.bus.degrees(dict(zip(MOTORS, robot.bus.ticks().tolist(), strict=True))).values())
    ready.actions.clear()
    observation, _ = env.reset()
    assert np.abs(np.array(list(ready.actions[0].values())) - there).max() < AHEAD
    assert steps(ready.actions).max() <= SLOWLY * 60 / RATE + 1e-9
    assert not observation["observation"][4:].any()


@pytest.mark.parametrize("share", [0.5, 0.35])
def test_a_soft_arm_goes_home_and_is_told_from_a_jammed_one(bench, share):
    robot = FakeSO101()
    robot.plant.model.actuator_gainprm[:, 0] *= share
    robot.plant.model.actuator_biasprm[:, 1] *= share
    robot.sleep(2)
    env = bench(robot=robot).env
    env.reset()
    assert np.abs(robot.goals_ahead()[:5]).max() > 2, "it is soft"
    there_and_back(env, 4)
    np.testing.assert_allclose(env.registers, 0, atol=1e-6)
    jammed(robot)
    assert abs(env.step(WORDS)[0]["observation"][6]) < 0.1


@pytest.fixture
def sent(ready, monkeypatch):
    """Goals (n, 6) in degrees, also those that tell the arm to hold."""
    goals, send = [], ready.robot.send_action
    monkeypatch.setattr(
        ready.robot, "send_action", lambda action: (goals.append([*action.values()]), send(action))
    )
    return goals


def all_goals_were_near(env, sent):
    assert np.abs(np.array(sent)[:, :5] - env.home).max() <= env.unit + 1e-9
    assert np.abs(np.diff(sent, axis=0)).max() <= 60 / RATE + 1e-9


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("degrees", [5, 9, 15, -20])
def test_an_arm_that_cannot_hold_its_weight_is_not_followed_down(ready, sent, moment, degrees):
    robot, env = ready.robot, ready.env
    env.step(WORDS)
    ready.then(moment, lambda: robot.weaken("elbow_flex", degrees))
    with pytest.raises(ArmError, match=r"motor elbow_flex (stays back|was told to be at)"):
        there_and_back(env, 5, -WORDS)
    goals = []
    for _ in range(3):
        with pytest.raises(ArmError, match=r"motor elbow_flex (stays back|was told to be at)"):
            env.reset()
        goals.append(sent[-1][2])
    assert np.abs(goals - env.home[2]).max() < 10, "where it was told to be before"
    assert np.ptp(goals) < 0.5
    all_goals_were_near(env, sent)
    robot.weaken("elbow_flex", 0)
    robot.sleep(1.0)
    env.reset()


def test_an_arm_that_sank_unseen_is_followed_once(ready, sent):
    ready.robot.weaken("elbow_flex", 12)
    ready.robot.sleep(1.0)
    for _ in range(3):
        with pytest.raises(ArmError, match="motor elbow_flex was told to be at"):
            ready.env.reset()
    off = np.array(sent)[:, 2] - ready.env.home[2]
    assert 8 < off[-1] < 16
    assert np.abs(np.diff(sent, axis=0)).max(1).astype(bool).sum() <= 1


def test_at_ctrl_c_a_motor_that_is_stopped_yields_at_the_speed_of_its_motion(ready, sent):
    ready.robot.jam("shoulder_pan")
    ticks = iter(range(100))
    ready.env._motors._on_tick = lambda *_: next(ticks) < 20 or interrupted(None)
    with pytest.raises(KeyboardInterrupt):
        ready.env.step(np.array([0.5, 0, 0, 0, 0]))
    assert max(np.array(sent)[:, 0]) - sent[-1][0] > 60 / RATE
    assert abs(ready.robot.goals_ahead()[0]) < 1
    all_goals_were_near(ready.env, sent)


def test_goals_catch_up_at_limited_speed_with_a_motor_that_was_weak_for_a_moment(ready, sent):
    robot, ticks = ready.robot, iter(range(1000))
    weak = dict.fromkeys((12, 13, 14), -15 * robot.world.signs[0])
    ready.env._motors._on_tick = lambda *_: robot.weaken("shoulder_pan", weak.get(next(ticks), 0))
    ready.env.step(np.array([0.7, 0, 0, 0, 0]))
    all_goals_were_near(ready.env, sent)
    assert sent[-1][0] - ready.env.home[0] == pytest.approx(0.7 * 45)


def test_a_wrong_reading_right_before_ctrl_c_moves_nothing_away(ready, sent, monkeypatch):
    robot, read = ready.robot, ready.robot.get_observation
    ready.env.step(WORDS)

    def misread():
        seen = read()
        return seen | {"elbow_flex.pos": seen["elbow_flex.pos"] - 20}

    def happens():
        monkeypatch.setattr(robot, "get_observation", misread)
        ready.then("streaming", lambda: interrupted(robot))

    ready.then("streaming", happens)
    with pytest.raises(KeyboardInterrupt):
        ready.env.step(-WORDS)
    all_goals_were_near(ready.env, sent)
    assert min(np.array(sent)[:, 2] - ready.env.home[2]) >= 45 * WORDS[2] - 0.1


def fallen(robot):
    """Power was off for a while, and is on again."""
    robot.plant.powered = False
    robot.sleep(3.0)
    robot.plant.powered = True


@pytest.fixture
def ahead(ready, monkeypatch):
    """How far goals were from where motors stood, in degrees, as each was sent."""
    found, send = [], ready.robot.send_action

    def sending(action):
        send(action)
        found.append(np.abs(ready.robot.goals_ahead()).max())

    monkeypatch.setattr(ready.robot, "send_action", sending)
    return found


@pytest.mark.parametrize("when", ["before", "while"])
def test_power_that_was_off_when_the_object_was_placed_is_noticed(ready, ahead, when):
    robot, env = ready.robot, ready.env
    env._place_object = lambda: fallen(robot) if when == "while" else None
    if when == "before":
        fallen(robot)
    ready.actions.clear()
    observation, _ = env.reset()
    assert max(ahead) < AHEAD
    assert not observation["observation"][4:].any()
    assert (np.sort(steps(ready.actions).max(1))[:-1] <= SLOWLY * 60 / RATE + 1e-9).all(), (
        "but when it is taken over"
    )


def test_a_motor_that_sank_before_power_was_off_does_not_leap(ready, ahead):
    robot, env = ready.robot, ready.env
    env.step(WORDS)
    robot.weaken("elbow_flex", -25)
    with pytest.raises(ArmError):
        there_and_back(env, 3)
    robot.weaken("elbow_flex", 0)
    robot.plant.posed_by_hand(robot.plant.angles + np.radians([20, 0, 0, 0, 0, 0]))
    robot.sleep(1.0)
    ahead.clear()
    env.reset()
    assert max(ahead) < AHEAD


class InHand:
    """Motors without torque, one of which a hand moves while it is told where it stands."""

    action_features: ClassVar = {"pan.pos": float}

    def __init__(self):
        self.at, self.time, self.sent, self.moves = 0.0, 0.0, [], 0.0
        self.sleep, self.clock = self._sleep, lambda: self.time

    def _sleep(self, seconds):
        self.time += seconds

    def get_observation(self):
        self.sleep(0.01)
        return {"pan.pos": self.at}

    def send_action(self, action):
        assert len(self.sent) < 100
        self.sent.append(action["pan.pos"])
        self.at += self.moves


@pytest.mark.parametrize("first", [True, False])
def test_an_error_while_motors_are_taken_over_sends_none_back(first):
    robot = InHand()
    motors = Motors(robot, ["pan"], lambda *_: 1 / (robot.moves == 0), None)
    if not first:
        motors.go_to(np.array([1.0]), 60)
    robot.sent.clear()
    robot.at = 40.0
    robot.sleep(10)
    robot.send_action = lambda action: (setattr(robot, "moves", 6.0), InHand.send_action(robot, action))
    with pytest.raises(ZeroDivisionError):
        motors.take_over()
    motors.hold()
    assert robot.sent == [40.0]


@pytest.mark.parametrize("fault", [no_packet, frozen])
def test_whatever_fails_after_power_was_off_no_motor_leaps(ready, ahead, fault):
    robot, env = ready.robot, ready.env
    ready.then("streaming", lambda: no_packet(robot))
    with pytest.raises(ArmError, match="no status packet"):
        env.step(WORDS)
    mend(robot)
    fallen(robot)
    ahead.clear()
    with pytest.raises(gym.error.ResetNeeded):
        env.step(WORDS)
    assert not ahead, "nothing is sent"
    fault(robot)
    with pytest.raises(ArmError, match=r"no status packet|no new picture"):
        env.reset()
    mend(robot)
    env.reset()
    assert max(ahead) < AHEAD


def test_goals_come_no_sooner_after_one_that_was_late(ready, monkeypatch):
    robot, read, send = ready.robot, ready.robot.get_observation, ready.robot.send_action
    times, late = [], itertools.cycle([0.0, 0.08])
    monkeypatch.setattr(robot, "get_observation", lambda: (robot.sleep(next(late)), read())[1])
    monkeypatch.setattr(robot, "send_action", lambda action: (times.append(robot.clock()), send(action)))
    ready.env.step(WORDS)
    assert np.diff(times).min() >= 1 / RATE - JITTER_S - 0.005


def test_a_wrong_reading_of_a_motor_that_rests_moves_nothing(ready, monkeypatch):
    read, wrong = ready.robot.get_observation, iter([0.0, 60.0])

    def misread():
        seen = read()
        return seen | {"gripper.pos": seen["gripper.pos"] + next(wrong, 0.0)}

    monkeypatch.setattr(ready.robot, "get_observation", misread)
    ready.actions.clear()
    with pytest.raises(ArmError, match="motor gripper says that it stands at"):
        ready.env.reset()
    assert not ready.actions


def test_a_motor_that_rests_is_not_lowered_where_it_only_sags(ready, monkeypatch):
    robot, read = ready.robot, ready.robot.get_observation

    def sagging():
        seen = read()
        return seen | {"shoulder_lift.pos": seen["shoulder_lift.pos"] - 4.0}

    monkeypatch.setattr(robot, "get_observation", sagging)
    ready.actions.clear()
    with pytest.raises(ArmError, match="on the way home motor shoulder_lift stays back"):
        ready.env.reset()
    assert steps(ready.actions).max() < 1e-9


def test_an_arm_that_was_kept_from_home_on_its_way_is_not_taken_to_be_there(bench):
    robot = FakeSO101()
    each = bench(robot=robot)
    home = dict(zip(MOTORS[:5], each.env.home.tolist(), strict=True))
    each = bench(robot=robot, home=home | {"shoulder_pan": home["shoulder_pan"] + 25})
    robot.jam("shoulder_pan")
    each.then("settling", lambda: robot.free("shoulder_pan"))
    each.env.reset()
    pan = robot.bus.degrees({"shoulder_pan": robot.bus.ticks()[0]})["shoulder_pan"]
    assert pan == pytest.approx(home["shoulder_pan"] + 25, abs=2)


def test_after_an_error_nothing_is_remembered_of_pictures(ready):
    robot, env = ready.robot, ready.env
    env.reset()
    robot.swapped = True
    with pytest.raises(ArmError, match="have they changed places"):
        there_and_back(env, 4)
    env.reset()
    assert env.step(WORDS)[0]["observation"][:4].all()


@pytest.mark.parametrize(
    ("part", "value", "said"),
    [
        ("elbow_flex.pos", None, "motor elbow_flex says that it stands at nan"),
        ("gripper.pos", None, "motor gripper says that it stands at nan"),
        ("elbow_flex.pos", "far", "could not convert string to float: 'far'"),
        ("right", None, "camera right has given no picture"),
    ],
)
def test_a_part_that_tells_nothing_is_named(ready, monkeypatch, part, value, said):
    read = ready.robot.get_observation
    monkeypatch.setattr(ready.robot, "get_observation", lambda: read() | {part: value})
    with pytest.raises(ArmError, match=said):
        ready.env.step(WORDS)


def test_a_camera_that_is_missing_is_named(ready, monkeypatch):
    read = ready.robot.get_observation
    monkeypatch.setattr(
        ready.robot, "get_observation", lambda: {k: v for k, v in read().items() if k != "right"}
    )
    with pytest.raises(ArmError, match="camera right has given no picture"):
        ready.env.step(WORDS)


def test_a_motor_that_does_not_go_home_is_told(ready):
    ready.env.step(WORDS)
    jammed(ready.robot)
    with pytest.raises(ArmError, match="on the way home motor elbow_flex stays back"):
        ready.env.reset()
