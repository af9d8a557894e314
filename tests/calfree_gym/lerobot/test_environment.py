"""The environment over a robot: what it sends, looks at, tells and refuses; agents reach, the arm holds."""

import gc
import json
import re
import subprocess
import sys
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import agents
from calfree_gym.lerobot import ArmError, LeRobotReachEnv, knowledge
from calfree_gym.lerobot.motors import AHEAD, RATE
from calfree_gym.lerobot.robot import Encoder, check_limits, read_encoders
from calfree_gym.vision import Marks, StereoTracker, TagTracker
from tests.calfree_gym.environments import assert_same
from tests.calfree_gym.lerobot.fake_so101 import Bus, Calibration, FakeSO101
from tests.calfree_gym.lerobot.so101 import MOTORS

WORDS = np.array([0.4, 0.2, -0.3, 0.1, 0.3], np.float32)


@pytest.mark.parametrize("speed", [20.0, 60.0])
def test_goals_go_ahead_in_small_steps(bench, speed):
    bench = bench(speed=speed)
    bench.env.reset()
    bench.actions.clear()
    bench.env.step(WORDS)
    sent = np.array([[action[f"{name}.pos"] for name in MOTORS[:5]] for action in bench.actions])
    assert np.abs(np.diff(sent, axis=0)).max() <= speed / RATE + 1e-9
    np.testing.assert_allclose(sent[-1] - bench.env.home, 45 * WORDS, atol=1e-5)
    assert np.abs(np.diff(sent, axis=0)).max() > 0.8 * speed / RATE, "and no smaller ones than they may be"


def test_no_goal_is_far_ahead_of_the_arm_even_where_it_does_not_follow(bench):
    ahead = []
    bench = bench(on_tick=lambda *_: ahead.append(np.abs(bench.robot.goals_ahead()[:5]).max()))
    bench.env.reset()
    bench.robot.jam("shoulder_pan")
    bench.env.step(WORDS)
    assert 2 < max(ahead) < AHEAD + 0.2


def test_what_is_looked_at_was_exposed_after_the_arm_had_settled(bench):
    bench = bench()
    env, cameras = bench.env, bench.robot.cameras.values()
    env.reset()
    settled = []
    seen = env._frames.settle
    env._frames.settle = lambda now: (settled.append(now), seen(now))
    for sign in (1, -1, 1, -1):
        env.step(sign * WORDS)
        for camera in cameras:
            latest = max(camera.looked)
            assert latest[0] > settled[-1] - 0.01
            assert latest[1] < 0.05, "rad/s"


def test_a_run_repeats_bit_by_bit(bench):
    def run():
        env = bench(seed=3).env
        first, _ = env.reset()
        return [first, *(env.step(sign * WORDS)[0] for sign in (1, -1))]

    assert_same(run(), run())


def test_images_end_where_the_space_says_and_points_are_in_halves_of_the_longer_side(bench):
    env = bench().env
    np.testing.assert_allclose(env.observation_space["achieved_goal"].high, [1, 0.75, 1, 0.75])
    observation, _ = env.reset()
    assert env.observation_space.contains(observation)
    servo = agents.make("unified_servo", env)
    np.testing.assert_allclose(servo.new_findings().edges, [[1, 0.75]] * 4)


def made(**config):
    robot = FakeSO101()
    vars(robot.config).update(config)
    return robot


class Wheels(FakeSO101):
    name = "lekiwi"
    action_features = property(lambda self: {"arm_elbow_flex.pos": float, "x.vel": float})


@pytest.mark.parametrize(
    ("home", "said"),
    [
        ("[" * 100_000, "is no file that the environment's save has written: RecursionError"),
        ([], "is no file that the environment's save has written: TypeError"),
        ({"degrees": 3}, "is no file that the environment's save has written: TypeError"),
        ({"others": {"gripper": "shut"}}, "is no file that the environment's save has written: ValueError"),
        ({"ticks": {"shoulder_pan": 2048}}, "'elbow_flex': None.*; allowed: a finite number of each motor"),
        ({"ticks": dict.fromkeys(MOTORS[:5], float("nan"))}, "'elbow_flex': nan"),
        ({"ticks": dict.fromkeys(MOTORS[:5], 10**400)}, "'elbow_flex': 10000"),
        ({"ticks": dict.fromkeys(MOTORS[:5], "2048")}, "'elbow_flex': '2048'"),
        ({"ticks": dict.fromkeys(MOTORS[:5], 10**6)}, "motor shoulder_pan is at 1000000 ticks at home"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_file_of_knowledge_whose_home_is_damaged_is_refused_and_changes_nothing(
    bench, tmp_path, home, said
):
    env, path = bench().env, tmp_path / "knowledge"
    agent, stood = Counting(env), env.home
    env.save(agent, path)
    with zipfile.ZipFile(path) as file:
        known, saved = file.read("agent"), json.loads(file.read("home.json"))
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("agent", known)
        home = saved | home if isinstance(home, dict) else home
        file.writestr("home.json", home if isinstance(home, str) else json.dumps(home))
    with pytest.raises(ValueError, match=said):
        env.load(agent, path)
    assert env.home is stood


@pytest.mark.parametrize("at", [7200.0, -181.0, float("nan")])
def test_without_encoders_home_is_at_most_half_a_turn_off(at):
    here = np.array([10.0, 0.0])
    check_limits({}, ["pan", "lift"], here + np.array([180, -180]), here, 45)
    with pytest.raises(
        ValueError, match=rf"motor lift is at {at:g} degrees at home, and stands at 0; allowed"
    ):
        check_limits({}, ["pan", "lift"], np.array([10.0, at]), here, 45)


class Absent(FakeSO101):
    def connect(self, calibrate=True):
        raise ConnectionError("Could not connect on port '/dev/ttyACM7'. Try running `lerobot-find-port`")


def in_per_cent(robot):
    """As LeRobot has the SO-101's gripper."""
    robot.bus.motors = {"gripper": SimpleNamespace(norm_mode="range_0_100")}
    return robot


def test_a_motor_may_sag_at_the_end_of_its_way():
    encoders = {"lift": Encoder(2047.5, 4095, 0, 0, 4095)}
    check_limits(encoders, ["lift"], np.zeros(1), np.zeros(1), 176.9)
    for home in (0.2, -0.2):
        with pytest.raises(ValueError, match="beyond its 34 to 4061"):
            check_limits(encoders, ["lift"], np.array([home]), np.zeros(1), 176.9)


def test_what_cannot_be_is_refused_before_anything_moves():
    cases = [
        (made(), {"cameras": ("left", "rigth")}, "no camera 'rigth' (did you mean right?); it has left"),
        (made(), {"cameras": ("left", "left")}, "each must be named once"),
        (made(), {"cameras": ("left",)}, "it must be the names of two of left, right"),
        (made(), {"motors": ["elbow"]}, "no motor 'elbow' (did you mean elbow_flex?)"),
        (made(), {"motors": []}, "the motors are none"),
        (made(), {"unit": 0}, "unit is 0; it must be a number above 0"),
        (made(), {"speed": "fast"}, "speed is 'fast'"),
        (made(), {"speed": 180}, "speed is 180; it must be a number above 0, at most 120"),
        (
            in_per_cent(made()),
            {"motors": MOTORS[2:]},
            "motor gripper goes by range_0_100; only motors that go",
        ),
        (made(), {"tolerance_px": float("nan")}, "tolerance_px is nan"),
        (made(), {"max_motions": 0}, "max_motions is 0"),
        (made(), {"marks": 3}, "marks is 3; allowed: Marks"),
        (made(), {"home": {"elbow_flex": 0}}, "it must map each of shoulder_pan"),
        (made(), {"home": dict.fromkeys(MOTORS[:5], "up")}, "home holds ['up'"),
        (made(), {"unit": 170}, "smaller unit"),
        (made(use_degrees=False), {}, "use_degrees=False; it must be True"),
        (Wheels(), {}, "the robot lekiwi takes actions x.vel; only positions (.pos) are allowed"),
        (made(max_relative_target=10), {}, "max_relative_target=10; it must be None, or 8.0 or more, as"),
        (made(max_relative_target=5.0), {}, "max_relative_target=5.0"),
    ]
    for robot, arguments, said in cases:
        stood = robot.plant.targets.copy()
        with pytest.raises(ValueError, match=re.escape(said)):
            LeRobotReachEnv(robot, **({"cameras": ("left", "right")} | arguments))
        np.testing.assert_array_equal(robot.plant.targets, stood)
    with pytest.raises(ConnectionError, match="lerobot-find-port"):
        LeRobotReachEnv(Absent(), ("left", "right"))
    with pytest.raises(FileNotFoundError):
        LeRobotReachEnv(FakeSO101(), ("left", "right"), marks="none.yaml")


def test_a_motor_whose_encoder_wraps_is_named_with_the_remedy():
    robot = made()
    robot.world.zeros[2] += 100 - robot.bus.ticks()[2]  # a horn that was screwed on so that its encoder wraps
    message = r"motor elbow_flex is at 100 ticks at home; .* -412 and 612"
    with pytest.raises(ValueError, match=message) as raised:
        LeRobotReachEnv(robot, ("left", "right"))
    remedy = re.search(r"robot\.bus\.set_half_turn_homings\(\[.*?\]\)", str(raised.value))[0]
    eval(remedy, {"robot": robot})
    LeRobotReachEnv(robot, ("left", "right"))


def test_marks_are_colours_a_file_or_a_tracker(bench, tmp_path):
    Marks().save(tmp_path / "marks.yaml")
    for marks in (Marks(), tmp_path / "marks.yaml", str(tmp_path / "marks.yaml"), StereoTracker()):
        assert bench(marks=marks).env.reset()[0]["observation"][:4].all()


class Counting:
    num_timesteps = 0

    def __init__(self, env):
        self.env = env

    def learn(self, total_timesteps, callback):
        self.env.reset()
        go_on = True
        while go_on:
            self.env.step(np.zeros(5))
            self.num_timesteps += 1
            go_on = callback(self)

    def save(self, path):
        path.write(b"%d" % self.num_timesteps)

    def load(self, path):
        self.num_timesteps = int(path.read())


def test_knowledge_is_saved_with_home_and_the_next_day_the_arm_goes_there_slowly(bench, tmp_path):
    today = bench(max_motions=2)
    agent = Counting(today.env)
    assert [reach.motions for reach in today.env.reaches(agent, 2)] == [2, 2]
    today.env.save(agent, tmp_path / "knowledge")
    home = today.robot.bus.ticks()[:5]

    other = bench(max_motions=2)
    robot, env = other.robot, other.env
    robot.send_action(
        {f"{name}.pos": at + 20 for name, at in robot.bus.sync_read("Present_Position").items()}
    )
    robot.sleep(2)
    robot.bus.set_half_turn_homings(["wrist_roll"])  # calibrated anew meanwhile
    env = LeRobotReachEnv(robot, ("left", "right"), max_motions=2, place_object=robot.place_object)
    known = Counting(env)
    known.num_timesteps = 4
    with pytest.raises(ValueError, match="learned in 4 motions from a home that is not known here; load it"):
        next(env.reaches(known, 1))
    with pytest.warns(UserWarning, match="motor gripper, which does not move"):
        env.load(known, tmp_path / "knowledge")
    began = robot.clock()
    env.reset()
    assert robot.clock() - began > 20 / (0.25 * 60), "slowly"
    assert np.abs(robot.bus.ticks()[:4] - home[:4]).max() <= 2 + 512 * 2 / 45
    assert known.num_timesteps == 4
    assert next(env.reaches(known, 1)).motions == 2


def test_a_file_of_knowledge_that_does_not_fit_is_refused(bench, tmp_path):
    env = bench().env
    agent = Counting(env)
    env.save(agent, tmp_path / "knowledge")
    said = f"{tmp_path / 'knowledge'} is of unit 45.0 (here 30.0); allowed: --unit=45.0, or another file"
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        bench(unit=30).env.load(agent, tmp_path / "knowledge")
    (tmp_path / "other").write_text("no knowledge")
    with pytest.raises(ValueError, match="is no file that the environment's save has written"):
        env.load(agent, tmp_path / "other")
    with pytest.raises(FileNotFoundError):
        env.load(agent, tmp_path / "missing")


@pytest.mark.parametrize(("at", "homed"), [(1000, 1100), (47, 60), (47, 4090), (4090, 30)])
def test_home_is_the_same_place_wherever_an_encoder_wraps(tmp_path, at, homed):
    def encoder(middle):
        return {"pan": Encoder(2047.5, 4095, middle - 2047, 0, 4095)}

    then, now = encoder(at), encoder(homed)
    knowledge.save(tmp_path / "home", Counting(None), {"pan": then["pan"].degrees(2047)}, {}, then, 45)
    _, home = knowledge.load(tmp_path / "home", None, ["pan"], {}, now, 45)
    assert now["pan"].ticks(home[0]) == pytest.approx((at - homed + 2047) % 4096)


class DynamixelBus(Bus):
    """Its motors add their offsets."""

    def read_calibration(self):
        return {
            name: replace(known, homing_offset=-known.homing_offset)
            for name, known in super().read_calibration().items()
        }


def test_dynamixels_are_home_where_they_were_whatever_was_calibrated_meanwhile(bench, tmp_path):
    robot = FakeSO101()
    robot.bus = DynamixelBus(robot.plant, robot.world)
    env = bench(robot=robot).env
    agent, stood = Counting(env), robot.plant.angles.copy()
    env.save(agent, tmp_path / "knowledge")
    robot.bus.set_half_turn_homings(["shoulder_pan"])
    env = bench(robot=robot).env
    env.load(agent, tmp_path / "knowledge")
    env.reset()
    assert np.degrees(np.abs(robot.plant.angles - stood)).max() < 4


def test_a_bus_that_does_not_count_in_ticks_has_no_encoders():
    limits = {"joint_1": Calibration(0, -90, 90)}
    robot = SimpleNamespace(bus=SimpleNamespace(read_calibration=lambda: limits))
    assert read_encoders(robot, ["joint_1"]) == {}


def test_motors_that_do_not_move_and_stand_elsewhere_than_they_did_are_named(bench, tmp_path):
    names = MOTORS[:4]
    env = bench(motors=names).env
    agent = Counting(env)
    env.save(agent, tmp_path / "knowledge")
    other = bench(motors=names)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        other.env.load(agent, tmp_path / "knowledge")
    now = other.robot.bus.sync_read("Present_Position")
    other.robot.send_action({f"{name}.pos": at + 40 * (name == "wrist_roll") for name, at in now.items()})
    other.robot.sleep(2)
    env = bench(robot=other.robot, motors=names).env
    with pytest.warns(UserWarning, match=r"motor wrist_roll, which .* stood at .* here it stands at"):
        env.load(agent, tmp_path / "knowledge")


def stand(robot, env):
    """Registers of where motors stand (5,)."""
    at = robot.bus.sync_read("Present_Position", MOTORS[:5])
    return (np.array([*at.values()]) - env.home) / env.unit


def test_a_sagging_arm_tells_what_it_was_told(ready):
    env = ready.env
    told, short, rng = np.zeros(5), [], np.random.default_rng(0)
    for _ in range(8):
        words = np.clip(told + rng.uniform(-0.3, 0.3, 5), -0.4, 0.4) - told
        told = told + words.astype(np.float32)
        observation, *_ = env.step(words)
        np.testing.assert_allclose(observation["observation"][4:], told, atol=1e-5)
        short.append(told - stand(ready.robot, env))
    assert env.unit * np.abs(short).max() > 0.8, "it does sag"


@pytest.mark.parametrize(("word", "stays"), [(0.3, True), (0.07, True), (0.02, False)])
def test_a_jammed_motor_tells_where_it_stands_and_the_others_what_they_were_told(ready, word, stays):
    env = ready.env
    ready.robot.jam("wrist_flex")
    observation, *_ = env.step(np.array([0, 0, 0, word, 0.02]))
    registers = observation["observation"][4:]
    if stays:
        assert registers[3] == pytest.approx(stand(ready.robot, env)[3], abs=0.01)
        assert abs(ready.robot.goals_ahead()[3]) < 0.5, "it does not push"
    else:
        assert registers[3] == pytest.approx(word)
    assert registers[4] <= 0.02 + 1e-6


def test_an_arm_that_has_met_something_stops_as_a_whole(ready):
    env = ready.env
    ready.robot.jam("shoulder_pan")
    words = np.array([0.5, 0, 0, 0.5, 0.5])
    observation, *_ = env.step(words)
    executed = observation["observation"][4:][[0, 3, 4]] / 0.5
    assert executed[0] < 0.1
    assert (executed < 0.9).all()


ROOT = Path(__file__).parents[3]


def over(power):
    robot = FakeSO101(power=power)
    return robot, LeRobotReachEnv(robot, ("left", "right"))


@pytest.mark.parametrize("ending", ["SIGINT", "SIGKILL", "exit"])
def test_torque_stays_on_however_the_process_ends(ending, tmp_path):
    power = tmp_path / "power"
    command = [sys.executable, "-m", "tests.calfree_gym.lerobot.moving", str(power), ending]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == {"SIGINT": -2, "SIGKILL": -9, "exit": 3}[ending], done.stderr
    assert float((tmp_path / "power.moving").read_text()) > 0.005, "it was on its way"
    assert power.read_text() == "on"


def test_lerobot_would_have_switched_it_off(tmp_path):
    power = tmp_path / "power"
    robot = FakeSO101(power=power)
    robot.connect(calibrate=False)
    assert power.read_text() == "on"
    del robot
    gc.collect()
    assert power.read_text() == "off"


def test_torque_stays_on_where_an_environment_is_closed_or_forgotten(tmp_path):
    power = tmp_path / "power"
    robot, env = over(power)
    with env:
        pass
    assert not robot.is_connected, "it has connected the robot"
    del env, robot
    gc.collect()
    assert power.read_text() == "on"


def test_who_breaks_off_a_release_leaves_the_arm_holding(ready, monkeypatch):
    def disconnect():
        raise KeyboardInterrupt

    monkeypatch.setattr(ready.robot, "disconnect", disconnect)
    with pytest.raises(KeyboardInterrupt):
        ready.env.release(lambda _: None)
    assert not ready.robot.config.disable_torque_on_disconnect


def test_what_is_closed_releases_no_more():
    env = LeRobotReachEnv(FakeSO101(), ("left", "right"))
    env.close()
    asked = []
    with pytest.raises(ArmError, match="not connected: only its power switch"):
        env.release(asked.append)
    assert not asked


def test_a_robot_that_was_connected_stays_so():
    robot = FakeSO101()
    robot.connect(calibrate=False)
    LeRobotReachEnv(robot, ("left", "right")).close()
    assert robot.is_connected


def test_torque_goes_once_it_is_confirmed_that_the_arm_is_supported(tmp_path):
    power = tmp_path / "power"
    robot, env = over(power)

    def nobody(question):
        raise EOFError

    with pytest.raises(EOFError):
        env.release(nobody)
    assert robot.is_connected
    assert power.read_text() == "on"
    asked = []
    env.release(asked.append)
    assert "Support the arm" in asked[0]
    assert not robot.is_connected
    assert power.read_text() == "off"


def test_a_robot_whose_torque_nobody_can_keep_is_told():
    robot = FakeSO101()
    robot.config = SimpleNamespace(id="other")
    with pytest.warns(UserWarning, match="its motors may lose their torque"):
        LeRobotReachEnv(robot, ("left", "right"))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_servo_reaches_in_spite_of_sag_play_ticks_and_webcams(bench, seed):
    bench = bench(seed=seed)
    servo = agents.make("unified_servo", bench.env)
    reaches, mm = [], []
    for reach in bench.env.reaches(servo, 3):
        reaches.append(reach)
        mm.append(bench.robot.distance_mm())
    assert all(reach.reached for reach in reaches)
    assert reaches[0].motions <= 16
    assert max(mm) < 8
    assert reaches[0].px <= 4 < reaches[0].before.px
    assert reaches[0].after.visible.all()
    assert servo.num_timesteps == sum(reach.motions for reach in reaches)


def test_a_servo_reaches_by_printed_tags(bench):
    bench = bench(robot=FakeSO101(0, tags=True), marks=TagTracker())
    for reach in bench.env.reaches(agents.make("unified_servo", bench.env), 2):
        assert reach.reached
        assert bench.robot.distance_mm() < 8


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["unified_servo", "memory"])
def test_a_life_with_a_knocked_camera_and_a_motor_replaced(agent, opengl):
    lived = []
    for seed in range(2):
        robot = FakeSO101(seed)
        env = LeRobotReachEnv(robot, ("left", "right"), place_object=robot.place_object)
        learner = agents.make(agent, env)
        for change, reaches in ((lambda: None, 10), (robot.knock, 5), (robot.shift_zero, 5)):
            change()
            for _ in range(reaches):
                try:
                    (reach,) = env.reaches(learner, 1)
                    of_reach = reach.motions, reach.reached
                except ArmError:
                    of_reach = env.motions, False
                lived.append((*of_reach, robot.distance_mm()))
    motions, reached, mm = np.transpose(lived)
    assert np.mean(reached) >= 0.95
    assert np.median(mm) < 5
    assert np.median(np.reshape(motions, (2, 20))[:, [10, 15]]) <= 20
