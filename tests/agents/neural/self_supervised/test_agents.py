"""Agents that teach themselves, in linear worlds where every answer is known."""

import numpy as np
import pytest

import agents
from agents.neural.self_supervised.self_taught import LearnedReach
from tests.agents.neural.self_supervised.conftest import QUICK, LinearWorld
from tests.agents.trials import assert_same_arrays, motions_of


def lengths(agent, env, trials=20):
    """Motions of some trials without learning; 30 where it did not arrive."""
    return np.array([len(list(motions_of(agent, env))) for _ in range(trials)])


@pytest.mark.parametrize("motors", [2, 3, 6])
def test_it_learns_to_reach_with_any_number_of_motors(linear, motors):
    agent, env = linear(motors=motors, settings={})
    assert lengths(agent, env).mean() < 4


def test_the_plain_form_learns_to_reach(linear):
    settings = {"hidden": (32,), "random_motions": 150, "learning_rate": 3e-3}
    agent, env = linear("cooperstock_milios", motions=400, settings=settings, tolerance=0.1)
    assert np.median(lengths(agent, env)) < 10


def test_the_unit_of_image_points_changes_nothing(linear):
    """Halves are exact in binary: all words are the same to the last bit."""
    settings = {**QUICK, "patience": 100}  # random words in a trial follow from its object's numbers
    (one, env), (half, small) = (linear(motions=120, settings=settings, unit=unit) for unit in (1, 0.5))
    observation, _ = env.reset()
    again, _ = small.reset()
    np.testing.assert_array_equal(one.predict(observation)[0], half.predict(again)[0])


def test_a_reversed_motor_is_told_and_the_replay_mended(linear):
    agent, env = linear(motions=250)
    env.signs[1] = -1
    agent.learn(60)
    assert [change[1].tolist() for change in agent.changes] == [[1, -1, 1]]
    assert 250 < agent.changes[0][0] <= 290
    pairs = agent.replay.sample(2000, np.random.default_rng(0))
    true = np.isclose(pairs.change, pairs.words * env.signs @ env.jacobian.T, atol=1e-5).all(1)
    assert true.mean() > 0.98  # it dates the change to a motion or two
    assert lengths(agent, env).mean() < 4


def test_what_a_trial_showed_of_the_network_does_not_correct_the_one_that_was_mended(linear, monkeypatch):
    """It would undo the mending."""
    agent, env = linear(motions=250)
    corrections, reverse = [], agent.model.reverse
    monkeypatch.setattr(agent, "new_findings", lambda: corrections.append(LearnedReach()) or corrections[-1])
    monkeypatch.setattr(
        agent.model, "reverse", lambda signs: found.extend(corrections[-1:]) or reverse(signs)
    )
    found = []
    env.signs[1] = -1
    agent.learn(60, callback=lambda progress: not found)
    assert found
    assert not found[0].changes
    assert not found[0].residuals


def test_another_change_is_told_and_the_replay_doubted(linear):
    agent, env = linear(motions=300, settings={"hidden": (32,), "updates": 2})
    env.jacobian = env.jacobian[[2, 3, 0, 1]]  # cameras have changed places
    agent.learn(150)
    assert [signs for _, signs in agent.changes if signs is not None] == []
    assert len(agent.changes) == 1
    assert agent.replay.sample(100, np.random.default_rng(0)).doubtful.any()
    assert lengths(agent, env).mean() < 4


@pytest.mark.parametrize(("noise", "outliers"), [(0.0, 0.0), (0.012, 0.0), (0.002, 0.1)])
def test_noise_is_no_change(linear, noise, outliers):
    agent, _ = linear(motions=400, noise=noise, outliers=outliers, tolerance=0.06, settings={})
    assert agent.changes == []


@pytest.mark.parametrize("name", ["self_supervised", "cooperstock_milios"])
def test_a_loaded_agent_learns_on_as_the_saved_one(linear, name, tmp_path):
    """What one seed learned serves another, too."""
    settings = {**QUICK, "random_motions": 20}
    agent, _ = linear(name, motions=80, settings=settings)
    agent.save(tmp_path / "agent.npz")
    again, other = (
        agents.make(name, LinearWorld(), seed=seed, **settings).load(tmp_path / "agent.npz")
        for seed in (0, 7)
    )
    assert_same_arrays(other, agent)
    assert other.learn(5).num_timesteps == 85
    for each in (agent, again):
        each.env.rng = np.random.default_rng(5)
        each.learn(30)
    assert_same_arrays(again, agent)


def test_a_trial_that_is_cut_off_teaches_what_was_seen_and_no_more(linear):
    agent, env = linear(motions=45)
    for _ in range(10):
        agent.learn(3)
    pairs = agent.replay.sample(2000, np.random.default_rng(0))
    np.testing.assert_allclose(pairs.change, pairs.words @ env.jacobian.T, atol=1e-6)


def test_it_goes_on_looking_where_it_has_arrived(linear):
    agent, env = linear(motions=250)
    env.tolerance = -1.0  # no distance ends the trial
    seen = [observation for _, observation, *_ in motions_of(agent, env)]
    far = [np.linalg.norm(each["achieved_goal"] - each["desired_goal"]) for each in seen]
    assert len(far) == 30
    assert max(far[12:]) < 0.01


def test_motors_that_move_nothing_are_no_error():
    env = LinearWorld()
    env.jacobian *= 0
    agent = agents.make("self_supervised", env, **QUICK).learn(60)
    assert not agent.model.ready


def test_it_gets_back_into_view():
    """Where a point is lost, it goes half of the way back to the nearest place, again and again."""
    env = LinearWorld()
    agent = agents.make("self_supervised", env, **QUICK).learn(60)
    observation, _ = env.reset()
    words, state = agent.predict(observation)
    observation, *_ = env.step(words)
    observation["observation"][0] = 0.0
    back, state = agent.predict(observation, state)
    np.testing.assert_allclose(back, -observation["observation"][4:] / 2, rtol=1e-6)


def test_a_file_of_other_settings_or_damaged_is_refused(linear, tmp_path):
    agent, env = linear(motions=60)
    path = tmp_path / "agent.npz"
    agent.save(path)
    with pytest.raises(ValueError, match=r"hidden=\(16,\).*hidden=\(8,\)"):
        agents.make("self_supervised", env, hidden=(8,)).load(path)
    with pytest.raises(ValueError, match=r"3 motors.*4 motors"):
        agents.make("self_supervised", LinearWorld(motors=4), **QUICK).load(path)
    with np.load(path) as file:
        arrays = dict(file)
    before = agent.arrays()
    agent.changes.append((50, None))
    for name, bad in (
        ("model/weights", arrays["model/weights"][:-1]),
        ("model/averaged", arrays["model/averaged"] * np.nan),
        ("detector/errors", np.zeros((2, 2))),
        ("model/weights", np.full(arrays["model/weights"].shape, 1e300)),
        ("model/averaged", np.full(arrays["model/averaged"].shape, 1e300)),
        ("model/center", np.full(8, 1e300)),
        ("model/first_moments", arrays["model/first_moments"] + 1.0),
        ("model/second_moments", -arrays["model/second_moments"] - 1.0),
        ("model/updates", np.array(-1.0)),
        ("model/image_scale", np.array(1e300)),
        ("model/register_scale", np.zeros(3)),
        ("usual_error", np.array(1e300)),
        ("trials", arrays["trials"] - 1),
    ):
        np.savez(tmp_path / "damaged.npz", **{**arrays, name: bad})
        with pytest.raises(ValueError, match=f"damaged.*{name.split('/')[-1]}"):
            agent.load(tmp_path / "damaged.npz")
    for key, array in agent.arrays().items():
        np.testing.assert_array_equal(before[key], array, key)
    assert agent.changes == [(50, None)]
    assert agent.load(path).changes == [], "those since it was loaded"


def test_it_reaches_in_a_wild_world(make_env):
    """Within a hundred motions, on either mount; here without the truth that scores it."""
    env = make_env(world="wild", truth=False)
    env.reset(seed=50_000)
    agent = agents.make("self_supervised", env).learn(120)
    assert np.mean([list(motions_of(agent, env))[-1][2] for _ in range(10)]) > 0.8
