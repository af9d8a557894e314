"""Changes of the world: what they are fitted by, told by, and what is then done about knowledge."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agents
from agents.adaptation.arm_change import fit_arm
from agents.adaptation.camera_change import fit_camera
from agents.adaptation.home_view import HomeView
from calfree_gym.image import IMAGE_UNIT
from tests.agents.lengths import Lengths
from tests.agents.test_gaussian_process import taught, view

PLACES = np.random.default_rng(0).uniform(-0.6, 0.6, (12, 3))
NOISE = np.random.default_rng(1).normal(0, 0.5 * IMAGE_UNIT, (12, 4))
KNOWLEDGE = taught(120)


def turned(points, roll=0.0, tilt=0.0, pan=0.0, zoom=1.0, focus=1.2):
    """Image points (n, 2) after the camera was turned by angles (rad) about its centre, and zoomed."""
    cos, sin = np.cos([roll, tilt, pan]), np.sin([roll, tilt, pan])
    about_z = np.array([[cos[0], -sin[0], 0], [sin[0], cos[0], 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cos[1], -sin[1]], [0, sin[1], cos[1]]])
    about_y = np.array([[cos[2], 0, sin[2]], [0, 1, 0], [-sin[2], 0, cos[2]]])
    rays = np.column_stack([points / focus, np.ones(len(points))]) @ (about_y @ about_x @ about_z).T
    return zoom * focus * rays[:, :2] / rays[:, 2:]


@settings(max_examples=40, deadline=None)
@given(st.floats(-np.pi, np.pi), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.8, 1.25))
def test_a_turned_and_zoomed_camera_is_fitted_from_a_dozen_points(roll, tilt, pan, zoom):
    """Against the homography of a pinhole camera, at places that were not fitted."""
    seen = view(PLACES) + NOISE
    seen[:, 2:] = turned(seen[:, 2:], roll, tilt, pan, zoom)
    change = fit_camera(KNOWLEDGE, 1, seen, PLACES)
    elsewhere = view(np.random.default_rng(2).uniform(-0.5, 0.5, (60, 3)))
    mapped, _ = change(elsewhere, np.zeros((60, 3)))
    off = np.hypot(*(mapped[:, 2:] - turned(elsewhere[:, 2:], roll, tilt, pan, zoom)).T) / IMAGE_UNIT
    np.testing.assert_array_equal(mapped[:, :2], elsewhere[:, :2])
    assert np.median(off) < 3
    assert change.deviation_px[0] == 0
    assert change.deviation_px[1] < 4


@pytest.mark.parametrize(
    ("kind", "motion"),
    [("rolled", {"roll": 0.5}), ("zoomed", {"zoom": 0.85}), ("re-aimed", {"tilt": 0.1, "pan": -0.1})],
)
def test_what_was_done_to_a_camera_is_called_by_its_name(kind, motion):
    seen = view(PLACES) + NOISE
    seen[:, :2] = turned(seen[:, :2], **motion)
    change = fit_camera(KNOWLEDGE, 0, seen, PLACES)
    assert change.kind == kind


def test_two_mistaken_points_hardly_change_the_fit():
    seen = view(PLACES) + NOISE
    seen[:, :2] = turned(seen[:, :2], roll=0.3)
    seen[:2, :2] += 0.3
    change = fit_camera(KNOWLEDGE, 0, seen, PLACES)
    assert change.map.rotation == pytest.approx(0.3, abs=0.03)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from([-1.0, 1.0]), st.floats(0.7, 1.4), st.floats(-0.1, 0.1))
def test_an_arm_of_another_sign_gain_and_zero_is_fitted(sign, gain, zero):
    """Registers that led to `once` are now once * scale + offset."""
    once = PLACES[:, :3] * 0.8
    now = once.copy()
    now[:, 1] = once[:, 1] * sign * gain + zero
    change = fit_arm(KNOWLEDGE, view(once) + NOISE, now)
    np.testing.assert_allclose(change.scale, [1, sign * gain, 1], atol=0.06)
    np.testing.assert_allclose(change.offset, [0, zero, 0], atol=0.03)
    assert change.deviation_px.max() < 4


def homes(count, seed, rate_px=0.0):
    home = HomeView()
    rng = np.random.default_rng(seed)
    for i in range(count):
        gone = np.array([i * rate_px * IMAGE_UNIT, 0, 0, 0])
        home.add(gone + rng.normal(0, 0.5 * IMAGE_UNIT, 4))
    return home


def test_a_view_that_only_trembles_neither_jumps_nor_drifts():
    alarms = 0
    for seed in range(60):
        home, rng = homes(3, seed), np.random.default_rng(1000 + seed)
        for _ in range(50):
            seen = rng.normal(0, 0.5 * IMAGE_UNIT, 4)
            alarms += home.jumped(seen).any()
            home.add(seen)
            alarms += home.drifting().any()
    assert alarms <= 3


def test_a_view_that_jumps_or_drifts_does_so_in_the_camera_that_moved():
    home = homes(20, 0)
    assert home.jumped(np.array([0, 0, 6 * IMAGE_UNIT, 0])).tolist() == [False, True]
    assert homes(30, 1, rate_px=0.2).drifting().tolist() == [True, False]
    np.testing.assert_allclose(homes(30, 1, 0.2).drift_rate(12)[0], 0.2 * IMAGE_UNIT, atol=0.15 * IMAGE_UNIT)
    assert not homes(30, 1, rate_px=0.2).jumped(np.array([30 * 0.2 * IMAGE_UNIT, 0, 0, 0])).any()


def lived(perturbations, mount="waist", motions=260, seed=3, **settings_):
    """An agent, and how long its trials were; what is scheduled at trial t strikes before its trial t."""
    log = Lengths(
        gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", perturbations=perturbations)
    )
    log.seed = seed
    return agents.make("memory", log, **settings_).learn(motions), log.lengths


AIM = [{"at": {"trial": 50}, "do": {"type": "camera_aim", "camera": "left", "degrees": 10}}]
ROLL = [{"at": {"trial": 50}, "do": {"type": "camera_roll", "camera": "right", "degrees": 40}}]
REPLACE = {"at": {"trial": 50}, "do": {"type": "camera_replace", "camera": "left"}}


@pytest.mark.parametrize("mount", ["waist", "stand"])
@pytest.mark.parametrize(("perturbations", "kind"), [(AIM, "re-aimed"), (ROLL, "rolled")])
def test_a_turned_camera_is_recognised_and_all_that_was_known_stays_of_use(mount, perturbations, kind):
    agent, lengths = lived(perturbations, mount)
    (event,) = agent.recognition.events
    assert (event.trial, event.kind, event.action) == (50, kind, "map")
    assert np.mean(lengths[53:73]) < 1.3


def test_who_never_acts_goes_on_missing_and_who_discards_starts_anew():
    never, lengths = lived(AIM, on_change="keep")
    assert not never.recognition.events
    assert np.mean(lengths[53:63]) > 2
    discarding, lengths = lived(AIM, on_change="discard")
    assert [event.action for event in discarding.recognition.events] == ["discard"]
    assert np.mean(lengths[51:54]) > np.mean(lived(AIM)[1][51:54])


def test_the_old_camera_is_met_with_what_was_known_of_it():
    """The very first trial after its return is like the ones before it was away."""
    agent, lengths = lived([REPLACE, {"at": {"trial": 80}, "undo": 0}])
    assert [event.kind for event in agent.recognition.events][-1] == "back"
    assert lengths[50] > 2
    assert np.mean(lengths[80:90]) < 1.3


def test_a_reversed_motor_is_told_from_a_changed_camera():
    agent, lengths = lived(
        [{"at": {"trial": 50}, "do": {"type": "motor_sign", "motor": "elbow"}}], motions=300
    )
    assert [event.kind for event in agent.recognition.events] == ["arm changed"]
    assert np.mean(lengths[54:74]) < 1.4


def test_quiet_worlds_give_hardly_an_alarm():
    """At most three in 3,000 trials are asked: here at most one in some 300."""
    assert sum(len(lived(None, motions=200, seed=seed)[0].recognition.events) for seed in (1, 2, 3)) <= 1


def test_an_agent_saved_while_it_thinks_over_a_change_goes_on_alike(tmp_path):
    """The same words, motion for motion, as the one that was not interrupted."""
    first, _ = lived([REPLACE], motions=110)
    assert first.recognition.events
    first.save(tmp_path / "agent.npz")
    second = agents.make("memory", first.env).load(tmp_path / "agent.npz")
    traces = []
    for agent in (first, second):
        env = gym.make("CalFree/Reach-v0", dynamics="kinematic", world=first.env.unwrapped.world)
        env.reset(seed=5)
        agent.env = env
        agent.learn(60)
        traces.append(agent.arrays())
    assert traces[0].keys() == traces[1].keys()
    for name, array in traces[0].items():
        np.testing.assert_array_equal(array, traces[1][name], err_msg=name)


def test_being_told_of_a_change_before_anything_is_known_changes_nothing():
    log = Lengths(gym.make("CalFree/Reach-v0", dynamics="kinematic"))
    agent = agents.make("memory", log)
    agent.recognition.announce_change(np.array([True, False]))
    agent.learn(20)
    assert not agent.recognition.events
    agent.recognition.announce_change(np.array([True, False]))
    agent.learn(20)
    assert len(agent.recognition.events) == 1


def test_it_needs_looks_at_the_gripper_to_see_change():
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic")
    with pytest.raises(ValueError, match="needs every_look"):
        agents.make("memory", env, every_look=False)
    with pytest.raises(ValueError, match="on_change is 'forget'; allowed: recognise, map, discard, keep"):
        agents.make("memory", env, on_change="forget")
