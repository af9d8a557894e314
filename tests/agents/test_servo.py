"""The servo against the true Jacobian of the simulation, and against the numbers asked of it."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import agents
import calfree_gym
from agents.agent import Look
from agents.jacobian import solve, solve_within
from agents.servo.unified import UnifiedServo
from experiments.evaluation import evaluate

MOUNTS = calfree_gym.MOUNTS


def numbers(count, low=-1.0, high=1.0):
    return st.lists(st.floats(low, high), min_size=count, max_size=count).map(np.array)


@settings(max_examples=50, deadline=None)
@given(numbers(12), numbers(3))
def test_solve_finds_the_words_where_the_world_is_linear(entries, words):
    jacobian = entries.reshape(4, 3) + np.eye(4, 3) * 3
    np.testing.assert_allclose(solve(jacobian, -jacobian @ words, 0.0), words, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(numbers(12), numbers(4), numbers(3, 0.01, 0.5))
@example(  # held back one after the other, motors would end further away
    np.array([-0.9375] * 9 + [0, -0.9375, -0.9375]), np.array([0.0, 0, 0, 1]), np.array([0.5, 0.125, 0.125])
)
def test_bounded_words_keep_within_bounds_help_and_are_the_best_where_none_binds(entries, distance, bounds):
    from scipy.optimize import lsq_linear

    jacobian = entries.reshape(4, 3) + np.eye(4, 3) * 3
    words = solve_within(jacobian, distance, 0.0, -bounds, bounds)
    assert (np.abs(words) <= bounds + 1e-12).all()
    best = lsq_linear(jacobian, -distance, (-bounds, bounds), method="bvls").cost
    ours = 0.5 * ((jacobian @ words + distance) ** 2).sum()
    assert ours <= 0.5 * (distance**2).sum() + 1e-9
    if (np.abs(solve(jacobian, distance, 0.0)) <= bounds).all():
        assert ours == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("mount", MOUNTS)
def test_test_motions_measure_the_sensor_control_jacobian(mount):
    """Noise-free columns from test motions against central differences of the simulation."""
    from dataclasses import replace

    env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic").unwrapped
    for seed in range(5):
        env.reset(seed=seed)
        env.set_world(replace(env.world, point_noise=0.0))
        look = Look.of(env.reset()[0])
        servo, seen = UnifiedServo(test_px=1.0), []
        running = servo(look)
        words = next(running)
        while len(seen) < 3:
            before = look
            look = Look.of(env.step(words)[0])
            if not (look.visible.all() and before.visible.all()):
                words = running.send(look)
                continue
            motor, executed = np.argmax(np.abs(words)), look.registers - before.registers
            moved = np.concatenate([look.gripper, look.object]) - np.concatenate(
                [before.gripper, before.object]
            )
            middle = (look.registers + before.registers) / 2
            true = _central_difference(env, middle, motor)
            np.testing.assert_allclose(moved / executed[motor], true, atol=0.03 * np.abs(true).max() + 0.02)
            seen.append(motor)
            words = running.send(look)


def _central_difference(env, registers, motor, step=1e-3):
    object_, points = env.arms.simulation.positions()[1][0], []
    twin = gym.make(
        "CalFree/Reach-v0", world=env.world, camera_mount=env.arms.mount, dynamics="kinematic"
    ).unwrapped
    for sign in (1, -1):
        twin.reset(seed=0, options={"object": object_})
        *_, info = twin.step(registers + sign * step * np.eye(3)[motor])
        points.append(info["truth"]["points"])
    return (points[0] - points[1]) / (2 * step)


@pytest.mark.parametrize("mount", MOUNTS)
def test_unified_servo_reaches_in_wild_worlds(mount):
    records = []
    for seed in range(60):
        env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", max_episode_steps=50)
        records += evaluate(agents.make("unified_servo", env), env, trials=1, seed=seed)
    assert np.mean([r.success for r in records]) >= 0.98
    assert np.median([r.motions for r in records]) <= 16
    assert np.median([r.distance_mm for r in records]) <= 5


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_camera_rolled_in_mid_trial_is_tolerated(mount):
    schedule = [{"at": {"motion": 3}, "do": {"type": "camera_roll"}}]
    successes = []
    for seed in range(40):
        env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", perturbations=schedule)
        successes += [r.success for r in evaluate(agents.make("unified_servo", env), env, 1, seed)]
    assert np.mean(successes) >= 0.95


@pytest.mark.parametrize("name", ["random", "unified_servo", "grid_table", "sac"])
def test_an_agent_needs_nothing_of_info_or_reward(name):
    class Blind(gym.Wrapper):
        def reset(self, **arguments):
            return self.env.reset(**arguments)[0], {}

        def step(self, action):
            observation, reward, terminated, truncated, _ = self.env.step(action)
            return observation, reward if name == "sac" else 0.0, terminated, truncated, {}

    words = []
    for wrapper in (lambda env: env, Blind):
        env = gym.make("CalFree/Reach-v0", dynamics="kinematic")
        env.reset(seed=3)
        tiny = {"net_arch": [16], "learning_starts": 20, "buffer_size": 500} if name == "sac" else {}
        agent = agents.make(name, wrapper(env), **tiny).learn(150)
        words.append(agent.predict(env.reset()[0])[0])
    np.testing.assert_array_equal(*words)
