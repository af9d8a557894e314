"""Any knowledge base over any servo; what a success teaches; worlds whose points come late or not at all."""

import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.knowledge.learning_servo import LearningServo
from agents.servo.unified import UnifiedServo
from calfree_gym.image import IMAGE_UNIT, lengths_px
from tests.agents import analytic
from tests.agents.trials import assert_same_arrays


@pytest.fixture
def lengths_of(live, make_env):
    """How many motions each whole trial takes in world 4, whose image points suffer from something."""

    def make(trouble, motions=250, name="memory", **settings):
        env = make_env(perturbations=[{"at": {"trial": 0}, "do": trouble}] if trouble else None)
        return live(name, env, 4, motions=motions, **settings)[1][:-1]

    return make


KNOWLEDGES = sorted(set(agents.KNOWLEDGE) - {"memory"})


@pytest.mark.parametrize(
    ("servo", "knowledge"),
    [
        pytest.param(servo, each, marks=[pytest.mark.slow] if i % len(KNOWLEDGES) != k else [])
        for i, servo in enumerate(sorted(agents.SERVOS))
        for k, each in enumerate(KNOWLEDGES)
    ],
)
def test_any_knowledge_makes_any_servo_faster(lengths_of, knowledge, servo):
    lengths = lengths_of(None, 700, "learning_servo", knowledge=knowledge, servo=servo)
    assert np.mean(lengths[-30:]) < 0.75 * np.mean(lengths[:3])


@pytest.fixture
def new_cameras(make_env):
    """Both cameras are others in every trial."""
    replaced = [{"type": "camera_replace", "camera": camera} for camera in ("left", "right")]
    return make_env(perturbations=[{"every": {"trial": 1}, "do": each} for each in replaced])


@pytest.mark.parametrize("name", ["unified_servo", pytest.param("memory", marks=pytest.mark.slow)])
def test_cameras_that_are_new_in_every_trial_never_make_it_worse(live, new_cameras, name):
    lengths = live(name, new_cameras, 0, motions=300)[1][:-1]
    assert len(lengths) > 30
    assert np.median(lengths[20:]) <= 1.25 * np.median(lengths[:20])


@pytest.mark.slow
def test_where_cameras_are_new_in_every_trial_memory_is_mostly_as_fast_as_its_servo(live, new_cameras):
    lengths = {
        name: np.concatenate([live(name, new_cameras, world, motions=200)[1][:-1] for world in range(6)])
        for name in ("memory", "unified_servo")
    }
    assert len(lengths["memory"]) > 120
    assert np.median(lengths["memory"]) <= 1.1 * np.median(lengths["unified_servo"])


def test_late_observations_teach_nothing_false(lengths_of):
    lengths = lengths_of({"type": "latency", "motions": 1})
    assert max(lengths) < 60
    assert np.mean(lengths[-20:]) < 1 + 1.8


def test_missing_points_are_waited_for(lengths_of):
    missing = {"type": "point_dropout", "share": 0.3}
    lengths, bare = lengths_of(missing, 400), lengths_of(missing, 400, "unified_servo")
    assert max(lengths) < 60
    assert np.mean(lengths[10:]) < 0.75 * np.mean(bare[10:])


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_trials_that_end_before_all_was_seen_are_lived_through(make_env, share):
    agent = in_short_trials(make_env, share).learn(300)
    assert agent.num_timesteps == 300


def test_trials_in_which_nothing_was_seen_teach_nothing(make_env):
    agent = in_short_trials(make_env, 1.0)
    with pytest.warns(UserWarning, match="no point has been seen"):
        agent.learn(40)
    assert_same_arrays(agent, in_short_trials(make_env, 1.0))


def in_short_trials(make_env, share):
    dropout = {"type": "point_dropout", "share": share}
    env = make_env(perturbations=[{"at": {"trial": 0}, "do": dropout}], max_episode_steps=4)
    env.reset(seed=3)
    return agents.make("memory", env)


class Notes:
    """Knows nothing, and notes what it is taught: the object as seen from home, and registers."""

    prior_knowledge = frozenset()

    def __init__(self, env):
        self.env = env
        self.taught = []

    def recall(self, sensors):
        return None

    jacobian = recall

    def arrays(self):
        return {}

    def learn(self, sensors, registers):
        at_home = analytic.points(self.env, np.zeros(3))
        np.testing.assert_allclose(sensors, at_home[2:].ravel(), atol=1e-6)
        ended_at = self.env.unwrapped.arms.registers[0].copy()
        points = [analytic.points(self.env, there) for there in (registers, ended_at)]
        self.taught.append([lengths_px(each[:2] - each[2:]).max() for each in points])


def test_what_a_success_teaches_is_where_gripper_and_object_would_have_met(noise_free, mount):
    taught = []
    for seed in range(4):
        notes = Notes(noise_free(mount, seed))
        LearningServo(notes.env, notes, UnifiedServo(), jump_px=np.inf, every_look=False).learn(60)
        taught += notes.taught
    corrected, ended = np.array(taught).T
    assert len(taught) > 20
    assert np.median(ended) > 1  # there was something to correct
    assert np.median(corrected) < 0.3 * np.median(ended)
    assert np.mean(corrected <= ended) > 0.9


def test_a_success_is_remembered_at_the_true_rendezvous(noise_free, mount):
    env = noise_free(mount, 5, terminate_on_success=False)
    env.reset()
    agent = agents.make("factored_table", env)
    wanted = analytic.rendezvous(env)
    for off in 0.003 * np.concatenate([np.eye(3), -np.eye(3)]):
        raw, *_ = env.step(wanted + off - env.arms.registers[0])
        last = Observation.of(raw)
        assert 0.2 < last.distance_px < LearningServo.LATE_PX
        found = agent._rendezvous(last, analytic.points_jacobian(env))
        assert np.linalg.norm(found - wanted) < 0.1 * np.linalg.norm(last.registers - wanted)


def test_what_ended_late_is_remembered_where_it_ended(make_env):
    agent = agents.make("factored_table", make_env())
    jacobian = np.random.default_rng(0).normal(size=(8, 3))
    points = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 10 * IMAGE_UNIT], [0.0, 0.0]])
    last = Observation(points, np.ones(4, bool), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(agent._rendezvous(last, jacobian), last.registers)


def test_what_is_expected_of_the_first_motion_is_told_before(live, make_env):
    env = make_env()
    empty = agents.make("memory", env)
    observation, _ = env.reset(seed=4)
    assert empty.expected_px(observation) is None
    agent = live("memory", make_env(), 4, motions=250)[0]
    errors, expected = [], []
    for trial in range(20):
        observation, _ = env.reset(seed=4 if trial == 0 else None)
        expected.append(agent.expected_px(observation))
        words, _ = agent.predict(observation)
        *_, info = env.step(words)
        errors.append(info["truth"]["error_px"])
    noise = 1.0  # of the object's points, in the worse image; it is no part of what is expected
    assert np.median(errors) < 2 * np.median(expected) + noise
    assert np.median(expected) < 4
