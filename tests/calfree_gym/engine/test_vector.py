"""Rows of a batched environment: worlds, how trials end and begin, attributes, and infos of one form."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from calfree_gym import nominal
from calfree_gym.tasks.reach import ReachArms
from tests.calfree_gym.environments import assert_same, begun, kinematic, make, of_row

WORD = np.full(3, 0.05)


def test_many_rows_change_no_row():
    few, many = kinematic(rows=3), kinematic(rows=67)
    few.reset(seed=0)
    many.reset(seed=0)
    for word in np.random.default_rng(1).uniform(-0.15, 0.15, (14, 3)):
        (a, *_), (b, *_) = (envs.step(np.tile(word, (envs.num_envs, 1))) for envs in (few, many))
        assert_same(a, {key: value[:3] for key, value in b.items()})


def test_worlds_may_differ_by_row():
    env = begun(make(rows=2, world=["nominal", "wild"]))
    assert env.unwrapped.worlds[0] == nominal()
    env.unwrapped.set_world(nominal(), row=1)
    assert env.unwrapped.worlds[1] == nominal()
    env = make(rows=2)
    env.unwrapped.set_world(nominal(), row=1)
    env.reset(seed=[5, None])
    assert env.unwrapped.worlds[1] == nominal()


@pytest.mark.parametrize("rows", [None, 2])
def test_trials_may_go_on_without_limit(rows):
    env = begun(kinematic(rows, max_episode_steps=-1, terminate_on_success=False))
    still = np.zeros(env.action_space.shape, np.float32)
    assert not any(np.any(env.step(still)[3]) for _ in range(62)), "60 is the usual limit"


def test_same_step_autoreset_gives_the_last_observation_and_the_next_first_one():
    after = kinematic(rows=3, max_episode_steps=4)
    at_once = kinematic(rows=3, max_episode_steps=4, autoreset_mode="SameStep")
    for envs, mode in ((after, AutoresetMode.NEXT_STEP), (at_once, AutoresetMode.SAME_STEP)):
        assert envs.autoreset_mode is envs.metadata["autoreset_mode"] is mode
    after.reset(seed=0)
    at_once.reset(seed=0)
    ended, words = 0, np.tile(WORD, (3, 1))
    for _ in range(9):
        last, *_, truncated, _ = after.step(words)
        first, *_, also_truncated, infos = at_once.step(words)
        np.testing.assert_array_equal(truncated, also_truncated)
        if truncated.all():
            ended += 1
            assert_same(list(infos["final_obs"]), [of_row(last, row) for row in range(3)])
            np.testing.assert_array_equal(infos["_final_obs"], True)
            last, *_ = after.step(words)
        assert_same(first, last)
    assert ended == 2


def test_without_autoreset_rows_wait_for_a_masked_reset():
    env = begun(kinematic(rows=3, max_episode_steps=4, autoreset_mode=AutoresetMode.DISABLED))
    words = np.tile(WORD, (3, 1))
    env.step(words)
    before, *_ = env.step(words)
    mask = np.array([False, True, False])
    observation, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation["observation"][1, 4:], 0)
    for key, value in before.items():
        np.testing.assert_array_equal(observation[key][~mask], value[~mask])
    for _ in range(2):
        *_, truncated, _ = env.step(words)
    np.testing.assert_array_equal(truncated, ~mask)
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 2\] are over"):
        env.step(words)
    env.reset(options={"reset_mask": ~mask})
    env.step(words)


ROWS = 3


def test_rows_have_attributes_and_methods_as_gymnasiums_list_of_single_environments_has():
    roll = [{"at": {"motion": 0}, "do": {"type": "camera_roll"}}]
    modes = ("vector_entry_point", "sync")
    rows, singles = both = [make(rows=ROWS, vectorization_mode=mode, perturbations=roll) for mode in modes]
    for envs in both:
        envs.reset(seed=5)
        envs.step(np.full((ROWS, 3), 0.1))
    for name in ("world", "home_seconds", "applied", "tolerance_px", "render_mode"):
        assert rows.get_attr(name) == singles.get_attr(name), name
    for name in ("observation_space", "action_space"):
        assert rows.get_attr(name) == singles.get_attr(name)
    goals = np.zeros(4), np.full(4, 0.5)
    assert rows.call("compute_reward", *goals, {}) == singles.call("compute_reward", *goals, {})
    states = rows.call("get_state")
    assert [state["registers"].tolist() for state in states] == rows.arms.registers.tolist()
    worlds = list(rows.get_attr("world"))[::-1]
    for envs in both:
        envs.set_attr("world", worlds)
        assert list(envs.get_attr("world")) == worlds
        envs.set_attr("world", worlds[0])
        assert envs.get_attr("world") == (worlds[0],) * ROWS
        assert envs.call("set_world", nominal()) == (None,) * ROWS
        assert envs.get_attr("world") == (nominal(),) * ROWS
        envs.set_attr("note", "shared")
        assert envs.get_attr("note") == ("shared",) * ROWS


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("camera_mount", "stand", "camera_mount is an argument of make_vec; make another"),
        ("autoreset_mode", "SameStep", "autoreset_mode is an argument of make_vec"),
        ("note", [1, 2, 3], r"note got \[1, 2, 3\]; all rows share it"),
        ("world", [nominal()] * 2, "world got 2 values; it must get 3, one a row, or one for all"),
    ],
)
def test_what_rows_cannot_have(name, value, message):
    rows = make(rows=ROWS)
    with pytest.raises(ValueError, match=message):
        rows.set_attr(name, value)
    with pytest.raises(AttributeError, match="no 'step' of its own"):
        rows.call("step", np.zeros(3))
    with pytest.raises(AttributeError, match="wrold"):
        rows.get_attr("wrold")


SCHEDULE = [
    {"every": {"motion": 2}, "do": {"type": "camera_roll"}},
    {"at": {"motion": 2}, "do": {"type": "motor_gain"}},
    {"at": {"trial": 1}, "do": {"type": "joint_zero"}},
]
MOTIONS = 4


def form(value):
    if isinstance(value, dict):
        return {key: form(each) for key, each in value.items()}
    return type(value), np.shape(value), np.asarray(value).dtype


def infos(env, shape, trials=3):
    found = [(env.reset(seed=0)[1], env.unwrapped.applied)]
    for _ in range(trials * MOTIONS):
        *_, terminated, truncated, info = env.step(np.full(shape, 0.05))
        found.append((info, env.unwrapped.applied))
        if len(shape) == 1 and (terminated or truncated):
            found.append((env.reset()[1], env.unwrapped.applied))
    return found


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


def told(infos):
    """What infos tell, without the numbers of rows of which they do not."""
    if not isinstance(infos, dict):
        return list(infos) if infos.dtype == object else infos
    whole = {key for key in infos if key[0] == "_" or key in ("final_obs", "final_info", "truth")}
    return {key: told(value if key in whole else value[infos["_" + key]]) for key, value in infos.items()}


def test_last_observations_are_those_of_gymnasiums_own_vector_environment():
    at_once = {"autoreset_mode": AutoresetMode.SAME_STEP}
    arguments = {"rows": 4, "perturbations": SCHEDULE, "max_episode_steps": 5, "tolerance_px": 120.0}
    listed = kinematic(vectorization_mode="sync", vector_kwargs=at_once, **arguments)
    made = [kinematic(**at_once, **arguments), listed]
    assert_same(*(envs.reset(seed=3)[0] for envs in made))
    ended = []
    for words in np.random.default_rng(0).uniform(-0.2, 0.2, (12, 4, 3)).astype(np.float32):
        (*ours, infos), (*theirs, expected) = (envs.step(words) for envs in made)
        assert_same(ours, theirs)
        assert_same(told(infos), told(expected))
        ended.append(sum(last is not None for last in infos.get("final_obs", [])))
    assert {1, 2, 3} & set(ended), "rows end alone, too"
    assert sum(ended) > 4


@pytest.mark.parametrize("rows", [None, 3])
def test_without_truth_infos_lack_it_and_nothing_else_changes(monkeypatch, rows):
    def steps(truth):
        env = make(rows=rows, truth=truth, max_episode_steps=6)
        words = np.random.default_rng(0).uniform(-0.2, 0.2, (6, *env.action_space.shape))
        return [env.reset(seed=3), *map(env.step, words)]

    full = steps(True)
    assert all(dtype.kind != "O" for _, _, dtype in _flat(form(full[0][1])))
    monkeypatch.setattr(ReachArms, "truth", None)  # not even computed
    for (*shown, info), other in zip(full, steps(False), strict=True):
        truth = {key: info.pop(key) for key in ("truth", "_truth") if key in info}
        assert len(truth) == (1 if rows is None else 2)
        assert_same((*shown, info), other)


def _flat(forms):
    for value in forms.values():
        yield from _flat(value) if isinstance(value, dict) else [value]


def test_same_step_infos_count_perturbations_of_rows_that_are_not_over():
    every = [{"every": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 0.1}}]
    env = kinematic(rows=2, world=nominal(), autoreset_mode="SameStep", perturbations=every)
    env.reset(seed=[0, 1])
    env.step(np.zeros((2, 3)))
    env.unwrapped._max_episode_steps = np.array([2, 60])
    *_, infos = env.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(infos["perturbed"], [0, 1])
    np.testing.assert_array_equal(infos["final_info"]["perturbed"], [1, 1])


def test_a_row_that_was_never_begun_has_no_registers_at_an_object():
    env = kinematic(rows=2, tell=("object_registers",))
    observation, _ = env.reset(seed=1, options={"reset_mask": np.array([True, False])})
    assert observation["object_registers"][0].any()
    assert not observation["object_registers"][1].any()


def test_a_trial_that_was_over_in_a_state_is_followed_by_the_next():
    one, rows = kinematic(), begun(kinematic(rows=2, max_episode_steps=1, autoreset_mode="SameStep"))
    begun(one).step(np.zeros(3))
    rows.unwrapped.set_state(one.unwrapped.get_state())
    rows.step(np.zeros((2, 3)))
    assert (rows.unwrapped.arms.trials == 2).all()
