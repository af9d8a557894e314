"""Infos have one form: data tools find the same keys, shapes and types at every step and reset."""

import numpy as np
import pytest

from calfree_gym.tasks.reach import ReachArms
from tests.calfree_gym.environments import assert_same, make

SCHEDULE = [
    {"every": {"motion": 2}, "do": {"type": "camera_roll"}},
    {"at": {"motion": 2}, "do": {"type": "motor_gain"}},
    {"at": {"trial": 1}, "do": {"type": "joint_zero"}},
]
ROWS, MOTIONS = 3, 4


def form(value):
    """Types and shapes in an info."""
    if isinstance(value, dict):
        return {key: form(each) for key, each in value.items()}
    return type(value), np.shape(value), np.asarray(value).dtype


def infos(env, shape, trials=3):
    """Of each reset and step, what it is said to hold and what was applied."""
    found = [(env.reset(seed=0)[1], env.unwrapped.applied)]
    for _ in range(trials * MOTIONS):
        *_, terminated, truncated, info = env.step(np.full(shape, 0.05))
        found.append((info, env.unwrapped.applied))
        if len(shape) == 1 and (terminated or truncated):
            found.append((env.reset()[1], env.unwrapped.applied))
    return found


@pytest.mark.parametrize("truth", [True, False])
def test_the_infos_of_a_single_arm_have_one_form(truth):
    env = make(perturbations=SCHEDULE, max_episode_steps=MOTIONS, truth=truth)
    found = infos(env, (3,))
    first = form(found[0][0])
    for info, applied in found:
        assert form(info) == first
        assert info["perturbed"] == len(applied)
    assert {int(info["perturbed"]) for info, _ in found} == {0, 1, 2}
    assert all(dtype.kind != "O" for _, _, dtype in _flat(first))
    assert ("truth" in first) == truth


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_infos_of_rows_have_one_form(mode):
    env = make(rows=ROWS, perturbations=SCHEDULE, max_episode_steps=MOTIONS, autoreset_mode=mode)
    first, applied_in_all = None, 0
    for info, applied in infos(env, (ROWS, 3)):
        final = info.pop("final_info", None)
        for name in ("final_obs", "_final_obs", "_final_info"):
            info.pop(name, None)
        first = first or form(info)
        assert form(info) == first
        assert final is None or form(final) == first
        counted = info["perturbed"] + (0 if final is None else final["perturbed"])
        np.testing.assert_array_equal(counted, [len(of_row) for of_row in applied])
        applied_in_all += counted.sum()
    assert applied_in_all > ROWS
    assert all(dtype.kind != "O" for _, _, dtype in _flat(first))


def test_rows_are_informed_as_gymnasiums_own_vector_environment_informs():
    arguments = {"rows": 2, "perturbations": SCHEDULE, "max_episode_steps": MOTIONS}
    batched = infos(make(**arguments), (2, 3))
    listed = make(vectorization_mode="sync", **arguments)
    other = [listed.reset(seed=0)[1]]
    other += [listed.step(np.full((2, 3), 0.05))[-1] for _ in range(3 * MOTIONS)]
    for (info, _), same in zip(batched, other, strict=True):
        assert form(info) == form(same)
        for name in ("is_success", "robot_seconds", "perturbed"):
            np.testing.assert_array_equal(info[name], same[name])
            np.testing.assert_array_equal(info["_" + name], same["_" + name])


@pytest.mark.parametrize("rows", [None, 3])
def test_without_truth_infos_lack_it_and_nothing_else_changes(monkeypatch, rows):
    def steps(truth):
        env = make(rows=rows, truth=truth, max_episode_steps=6)
        words = np.random.default_rng(0).uniform(-0.2, 0.2, (6, *env.action_space.shape))
        return [env.reset(seed=3), *map(env.step, words)]

    full = steps(True)
    monkeypatch.setattr(ReachArms, "truth", None)  # not even computed
    for (*shown, info), other in zip(full, steps(False), strict=True):
        truth = {key: info.pop(key) for key in ("truth", "_truth") if key in info}
        assert len(truth) == (1 if rows is None else 2)
        assert_same((*shown, info), other)


def _flat(forms):
    for value in forms.values():
        yield from _flat(value) if isinstance(value, dict) else [value]
