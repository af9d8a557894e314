"""Keep, map, discard or recall: what is done about knowledge, in worlds that change while an agent lives."""

import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.memory.adaptive_memory import AdaptiveMemory, Change, WorldEvent
from agents.memory.detector import ChangeVerdict, Finding
from calfree_gym.perturbations import CameraAim, CameraReplace
from tests.agents.memory.gripper_views import known, trial, wild
from tests.agents.trials import STAND_FIRST, assert_same_arrays


@pytest.fixture
def lived(live, make_env):
    """An agent with memory, and how long its trials were; what is scheduled at trial t comes before it."""

    def make(perturbations, mount="waist", motions=260, seed=3, **settings):
        return live("memory", make_env(mount, perturbations=perturbations), seed, motions=motions, **settings)

    return make


def fiftieth(kind, **more):
    """A perturbation before trial 50."""
    return {"at": {"trial": 50}, "do": {"type": kind, **more}}


AIM = [fiftieth("camera_aim", camera="left", degrees=10)]
ROLL = fiftieth("camera_roll", camera="right", degrees=40)
REPLACE = fiftieth("camera_replace", camera="left")


@pytest.mark.parametrize(
    ("perturbations", "kind"), [(AIM, "re-aimed"), pytest.param([ROLL], "rolled", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_a_turned_camera_is_recognised_and_all_that_was_known_stays_of_use(lived, mount, perturbations, kind):
    agent, lengths = lived(perturbations, mount)
    (event,) = agent.adaptation.events
    assert (event.trial, event.kind, event.action) == (50, kind, "map")
    assert np.mean(lengths[53:73]) < 1.3


@pytest.mark.slow
def test_who_never_acts_goes_on_missing_and_who_discards_starts_anew(lived):
    never, lengths = lived(AIM, on_change="keep")
    assert not never.adaptation.events
    assert np.mean(lengths[53:63]) > 2
    discarding, lengths = lived(AIM, on_change="discard")
    assert [event.action for event in discarding.adaptation.events] == ["discard"]
    assert np.mean(lengths[51:54]) > np.mean(lived(AIM)[1][51:54])


def test_the_old_camera_is_met_with_what_was_known_of_it(lived):
    """The very first trial after its return is like the ones before it was away."""
    agent, lengths = lived([REPLACE, {"at": {"trial": 80}, "undo": 0}])
    assert [event.kind for event in agent.adaptation.events][-1] == "back"
    assert lengths[50] > 2
    assert np.mean(lengths[80:90]) < 1.3


def test_a_reversed_motor_is_told_from_a_changed_camera(lived):
    agent, lengths = lived([fiftieth("motor_sign", motor="elbow")], motions=300)
    assert [event.kind for event in agent.adaptation.events] == ["arm changed"]
    assert np.mean(lengths[54:74]) < 1.4


@pytest.mark.slow
def test_quiet_worlds_give_hardly_an_alarm(lived):
    """At most three in 3,000 trials are asked: here at most one in some 300."""
    assert sum(len(lived(None, motions=200, seed=seed)[0].adaptation.events) for seed in (1, 2, 3)) <= 1


def test_an_agent_saved_while_it_explains_a_change_goes_on_alike(lived, make_env, tmp_path):
    """The same words, motion for motion, as the one that was not interrupted."""
    first, _ = lived([REPLACE], motions=90)
    assert first.adaptation.change is not None
    first.save(tmp_path / "agent.npz")
    second = agents.make("memory", first.env).load(tmp_path / "agent.npz")
    for agent in (first, second):
        env = make_env(world=first.env.unwrapped.world)
        env.reset(seed=5)
        agent.env = env
        agent.learn(60)
    assert_same_arrays(first, second)


def test_a_saved_agent_rests_from_its_memory_as_the_one_that_goes_on(make_env, tmp_path):
    """After a trial that gave up what was remembered; one that had not is saved before it."""
    agent, words = agents.make("memory", make_env()).learn(60), []
    observation, _ = agent.env.reset()
    agent.save(tmp_path / "before.npz")
    findings = agent.new_findings()
    findings.given_up = True
    agent.learn_trial(findings, Observation.of(observation), False)
    agent.save(tmp_path / "after.npz")
    for file in ("after", "before", "after"):
        words.append(agent.predict(observation)[0])
        agent.load(tmp_path / f"{file}.npz")
    np.testing.assert_array_equal(words[0], words[1])
    assert (words[2] != words[0]).any()


def test_a_change_announced_before_anything_is_known_changes_nothing(make_env):
    agent, cameras = agents.make("memory", make_env()), np.array([True, False])
    agent.adaptation.announce_change(cameras)
    assert not agent.learn(20).adaptation.events
    agent.adaptation.announce_change(cameras)
    assert len(agent.learn(20).adaptation.events) == 1


def test_an_announced_change_is_saved(make_env, tmp_path):
    """Else what is loaded would go on by what it was told not to trust."""
    agent = agents.make("memory", make_env()).learn(60)
    agent.adaptation.announce_change(np.array([True, False]))
    agent.save(tmp_path / "agent.npz")
    loaded = agents.make("memory", make_env()).load(tmp_path / "agent.npz")
    observation, _ = agent.env.reset()
    assert agent.expected_px(observation) is None
    assert loaded.expected_px(observation) is None


@pytest.mark.parametrize("jumped", [0, 2])
@pytest.mark.parametrize(
    ("perturbation", "events"), [(None, []), (CameraAim(camera="left", degrees=8), ["map"])]
)
def test_where_nothing_has_changed_what_is_seen_explains_it_better(monkeypatch, perturbation, events, jumped):
    """Whatever the detector says: it judges by errors, and those may come from the wrong smoothness.

    So it may be, too, where the servo reports a jump that the detector does not confirm.
    """
    world = wild(4112)
    memory = AdaptiveMemory(known(world))
    if perturbation:
        world = perturbation.apply(world, np.random.default_rng(0))
    seen = trial(world, 30)
    looks = len(memory.known.gripper)
    learn_as_changed(memory, seen, monkeypatch, jumped)
    assert [event.action for event in memory.events] == events
    assert len(memory.known.gripper) > looks


@pytest.mark.parametrize("perturbation", [CameraAim(camera="left", degrees=8), CameraReplace(camera="right")])
def test_a_camera_that_changes_in_mid_trial_is_met_once_and_costs_no_trial(perturbation):
    """That trial's home, and the object from there, were seen before."""
    world = wild(4112)
    memory, changed = AdaptiveMemory(known(world)), perturbation.apply(world, np.random.default_rng(0))
    for number in range(25):
        memory.learn(looks_of(trial(world, 100 + number)), 0.5)
    assert not memory.events
    earlier, later = looks_of(trial(world, 200)), looks_of(trial(changed, 200, places=6))
    memory.learn([*earlier[:2], *later[2:]], 0.5)
    (event,) = memory.events
    assert memory.known_for(later[0]) is memory.known
    for number in range(6):
        memory.learn(looks_of(trial(changed, 201 + number)), 0.5)
    assert [each.trial for each in memory.events] == [event.trial]
    assert np.median(memory.known.errors(trial(changed, 300, places=9))[0]) < 8


def test_a_trial_in_which_nothing_changed_tells_more_of_the_change_before(monkeypatch):
    world = wild(4112)
    memory = AdaptiveMemory(known(world))
    before = trial(world, 10)
    memory.events.append(WorldEvent(0, "unknown", "map"))
    memory.change = Change(memory.known.copy(), np.array([True, False]), before)
    seen = trial(world, 30)
    learn_as_changed(memory, seen, monkeypatch)
    assert len(memory.change.after_change) == len(before) + len(seen)


def learn_as_changed(memory, seen, monkeypatch, jumped=0):
    """Learns a trial in which the detector takes the left camera for changed."""
    changed = Finding(ChangeVerdict.CHANGED, seen, np.array([True, False]), seen.sensors[0])
    memory.detector.home.add(seen.sensors[0], 0.5, int(seen.trials[0]))
    monkeypatch.setattr(memory.detector, "examine", lambda *_: changed)
    memory.learn(looks_of(seen), 0.5, jumped)


def looks_of(seen):
    """Pairs as they were observed."""
    shown = np.concatenate([seen.sensors, seen.objects], 1).reshape(-1, 4, 2)
    visible = np.isfinite(shown).all(2)
    return [Observation(*each) for each in zip(np.nan_to_num(shown), visible, seen.registers, strict=True)]


def test_images_without_noise_teach_of_an_object_that_stands_still(make_env, live):
    """It is seen just where it was seen from home, and is known all the same."""
    exact = [{"at": {"trial": 0}, "do": {"type": "point_noise", "px": 0.0}}]
    _, lengths = live("memory", make_env("stand", perturbations=exact), 0, trials=12)
    assert max(lengths[2:]) < 20


def test_a_camera_that_does_not_show_home_tells_of_no_change():
    adaptation = AdaptiveMemory(known(wild(0), 12))
    for number in range(12, 16):
        pairs = trial(wild(0), number)
        adaptation.detector.home.add(pairs.sensors[0], 0.5, number)
    points = np.concatenate([pairs.sensors[0], pairs.homes[0]]).reshape(4, 2)
    points[0] += 0.3
    for seen, knows in (([True] * 4, False), ([False, True, True, True], True)):
        home = Observation(points, np.array(seen), np.zeros(3))
        assert (adaptation.known_for(home) is not None) == knows


@pytest.mark.parametrize(("first", "last", "jumped", "least"), [(4, 9, 4, 4 * 5 + 5 * 2), (8, 11, 1, 0)])
def test_changes_that_do_not_outlast_their_trial_leave_what_is_known_right(first, last, jumped, least):
    """A camera is knocked in every trial, in its middle or at once, each time another way, and set right."""
    world, rng = wild(4112), np.random.default_rng(0)
    memory = AdaptiveMemory(known(world, first))
    for number in range(first, last):
        knocked = CameraAim(camera="left", degrees=10, direction=rng.uniform(-180, 180)).apply(world, rng)
        earlier, later = looks_of(trial(world, number)), looks_of(trial(knocked, number, places=4 + jumped))
        memory.learn([*earlier[:jumped], *later[jumped:]], 0.5, jumped=jumped)
    seen = trial(world, 300, places=9)
    now_known = memory.known_for(looks_of(seen)[0])
    assert np.median(now_known.errors(seen)[0]) < 2
    assert len(now_known.gripper) > least


@pytest.mark.parametrize("motion", [69, 70, 71])
def test_an_arm_that_changed_in_mid_trial_is_not_taken_for_the_old_one_where_home_is_as_before(
    live, make_env, motion
):
    """A few looks do not tell a reversed motor from other cameras."""
    reverse = [{"at": {"motion": motion}, "do": {"type": "motor_sign", "motor": "elbow"}}]
    env = make_env(world="wild", perturbations=reverse, terminate_on_success=False, max_episode_steps=4)
    agent, _ = live("memory", env, 640000, motions=4 * 22)
    assert [event.trial for event in agent.adaptation.events] == [(motion + 1) // 4]


def test_a_servo_tells_memory_since_when_a_camera_has_been_elsewhere(make_env, monkeypatch):
    trials = []
    knock = [{"at": {"motion": 27}, "do": {"type": "camera_aim", "camera": "left", "degrees": 10}}]
    env = make_env(perturbations=knock, terminate_on_success=False, max_episode_steps=6)
    agent = agents.make("memory", env)
    learn = agent.adaptation.learn
    monkeypatch.setattr(agent.adaptation, "learn", lambda *each: (trials.append(each[2]), learn(*each)))
    agent.learn(6 * 5)
    assert trials[:4] == [0, 0, 0, 0]
    assert trials[4] == 27 - 4 * 6 + 1
