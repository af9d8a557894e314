"""The Gaussian process against its definition, and against the geometry of the arm."""

import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.knowledge.gaussian_process import GaussianProcess
from calfree_gym.image import IMAGE_UNIT
from tests.agents.analytic import distance_jacobian


def view(registers):
    """A smooth stereo view of three registers."""
    a, b, c = np.moveaxis(np.asarray(registers), -1, 0)
    return 0.5 * np.stack(
        [np.sin(a + 0.3 * b), np.sin(b - 0.4 * c), np.sin(a - 0.3 * c) + 0.2 * b * c, np.cos(c) + b], -1
    )


def taught(count, seed=0, noise_px=0.5, **settings):
    rng = np.random.default_rng(seed)
    knowledge = GaussianProcess(3, **settings)
    for registers in rng.uniform(-0.7, 0.7, (count, 3)):
        knowledge.learn(view(registers) + rng.normal(0, noise_px * IMAGE_UNIT, 4), registers)
    return knowledge


@pytest.mark.parametrize("count", [20, 75])
def test_views_are_the_posterior_of_the_kernel_as_defined(count):
    """Against the textbook formula, written out entry by entry."""
    knowledge = taught(count)
    knowledge.map(lambda sensors, registers: (sensors, registers), np.array([3.0, 0.0]))

    def kernel(first, second):
        x, y = first / 0.6, second / 0.6
        return (1 + x @ y) ** 2 + 0.05 * np.exp(-((x - y) ** 2).sum() / 2)

    places = np.random.default_rng(1).uniform(-0.7, 0.7, (5, 3))
    views, variances = knowledge.views(places)
    for camera, noise_px in enumerate((np.hypot(0.7, 3), 0.7)):
        covariance = np.array([[kernel(x, y) for y in knowledge.registers] for x in knowledge.registers])
        covariance += (noise_px * IMAGE_UNIT) ** 2 * np.eye(count)
        for place, seen, variance in zip(places, views, variances, strict=True):
            between = np.array([kernel(place, x) for x in knowledge.registers])
            weights = np.linalg.solve(covariance, between)
            own = slice(2 * camera, 2 * camera + 2)
            np.testing.assert_allclose(seen[own], weights @ knowledge.sensors[:, own], atol=1e-6)
            assert variance[camera] == pytest.approx(kernel(place, place) - weights @ between, abs=1e-8)


def test_its_jacobian_is_the_derivative_of_its_views():
    knowledge = taught(40)
    for registers in np.random.default_rng(2).uniform(-0.6, 0.6, (5, 3)):
        steps = np.concatenate([np.eye(3), -np.eye(3)]) * 1e-4
        ahead, behind = knowledge.views(registers + steps)[0].reshape(2, 3, 4)
        np.testing.assert_allclose(knowledge.jacobian(registers), (ahead - behind).T / 2e-4, atol=1e-5)


def test_what_it_recalls_is_where_the_object_is_seen_and_its_confidence_is_honest():
    knowledge = taught(120)
    off, claimed = [], []
    for registers in np.random.default_rng(3).uniform(-0.6, 0.6, (100, 3)):
        recall = knowledge.recall(view(registers))
        missed = (view(recall.registers) - view(registers)) / IMAGE_UNIT
        off.append(max(np.hypot(*missed[:2]), np.hypot(*missed[2:])))
        claimed.append(recall.deviation_px)
    assert np.median(off) < 1
    assert np.max(off) < 4
    assert 0.3 < np.median(off) / np.median(claimed) < 3


def test_what_contradicts_itself_is_recalled_with_little_confidence():
    """Four coordinates of one object must fit three registers: a point 30 px off in one camera does not."""
    knowledge = taught(120)
    seen = view(np.array([0.1, 0.2, -0.1]))
    assert knowledge.recall(seen).deviation_px < 3
    direction = np.linalg.svd(knowledge.jacobian(np.array([0.1, 0.2, -0.1])))[0][:, -1]
    assert knowledge.recall(seen + 30 * IMAGE_UNIT * direction).deviation_px > 15


def test_it_keeps_what_adds_most_and_no_more_than_its_bound():
    few, all_ = taught(400, points=60), taught(400, points=1_000)
    assert 60 <= len(few.registers) <= 60 + GaussianProcess.SPARE
    assert len(all_.registers) == 400
    places = np.random.default_rng(4).uniform(-0.6, 0.6, (50, 3))
    off = np.abs(few.views(places)[0] - view(places)).max(1) / IMAGE_UNIT
    assert np.median(off) < 1.5
    assert (np.ptp(few.registers, axis=0) > 1.2).all()


def test_looks_at_one_place_are_averaged_and_follow_what_goes_on_there():
    rng = np.random.default_rng(5)
    knowledge = GaussianProcess(3)
    for _ in range(50):
        knowledge.learn(np.full(4, 0.25) + rng.normal(0, 0.5 * IMAGE_UNIT, 4), np.zeros(3))
    assert len(knowledge.registers) == 1
    np.testing.assert_allclose(knowledge.sensors[0], 0.25, atol=0.5 * IMAGE_UNIT)
    for _ in range(50):
        knowledge.learn(np.full(4, 0.3), np.zeros(3))
    np.testing.assert_allclose(knowledge.sensors[0], 0.3, atol=0.5 * IMAGE_UNIT)


def test_a_saved_one_recalls_bit_for_bit_alike_and_goes_on_alike():
    first, second = taught(90, points=50), GaussianProcess(3, points=50)
    second.restore({name: array.copy() for name, array in first.arrays().items()})
    for registers in np.random.default_rng(6).uniform(-0.6, 0.6, (60, 3)):
        recalls = [knowledge.recall(view(registers)) for knowledge in (first, second)]
        assert recalls[0].registers.tobytes() == recalls[1].registers.tobytes()
        assert recalls[0].deviation_px == recalls[1].deviation_px
        for knowledge in (first, second):
            knowledge.learn(view(registers), registers)


def test_it_implies_the_true_jacobian_where_the_cameras_ride_on_the_arm_and_where_not(make_env, mount):
    """At rendezvous, after some trials of its own; by MuJoCo's derivatives."""
    env = make_env(mount)
    env.reset(seed=7)
    agent = agents.make("memory", env)
    agent.learn(150)
    assert agent.camera_motors.tolist() == [mount == "waist", False, False]
    observation, _ = env.reset()
    state, over = None, False
    while not over:
        words, state = agent.predict(observation, state)
        observation, _, terminated, truncated, _ = env.step(words)
        over = terminated or truncated
    last = Observation.of(observation)
    implied = agent.implied_jacobian(agent.knowledge, last.registers)
    truth = distance_jacobian(env)
    off = np.linalg.norm(implied[:4] - implied[4:] - truth, axis=0) / np.linalg.norm(truth, axis=0)
    assert (off < 0.15).all()


def test_a_few_dozen_reaches_make_nearly_every_further_one_a_single_motion(live, make_env, mount):
    env = make_env(mount)
    env.reset(seed=11)
    _, lengths = live("memory", env, motions=220)
    assert np.mean(lengths[60:-1]) < 1.2
    assert np.mean(lengths[60:-1]) < np.mean(lengths[:3]) / 2


def test_a_bound_too_small_is_refused():
    with pytest.raises(ValueError, match="points is 3; it must be a whole number, 10 or more"):
        GaussianProcess(3, points=3)
