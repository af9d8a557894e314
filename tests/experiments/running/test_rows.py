"""Rows of one world as one lifetime: counted together, perturbed together, as every other agent is."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from experiments.config.environment import EnvironmentConfig
from experiments.config.requirements import requirements, unfit_life
from experiments.config.suite import AgentConfig, ScenarioConfig
from experiments.evaluation import TrialRecord
from experiments.running import worker
from experiments.running.lifetime import LifetimeRecorder, RowsRecorder
from tests.agents.neural.quick import QUICK
from tests.experiments.fakes import lived, runs, watched

ENV = EnvironmentConfig(id="CalFree/ReachDense-v0", world="wild", dynamics="kinematic", max_episode_steps=8)
AIM = {"type": "camera_aim", "camera": "left"}  # by how much is drawn
PPO = {"name": "ppo", "settings": {**QUICK["ppo"], "rows": 4}}


def recorded(rows=4, schedule=(), on_trial=lambda record: None, **changes):
    return RowsRecorder(ENV.model_copy(update=changes), rows, (), tuple(schedule), 5, on_trial)


def words(rows, seed=0):
    return np.random.default_rng(seed).uniform(-0.2, 0.2, (rows, 3)).astype(np.float32)


@pytest.mark.parametrize("at", [{"trial": 3}, {"motion": 28}], ids=str)
def test_rows_meet_the_worlds_and_perturbations_of_a_servo(suite_data, tmp_path, monkeypatch, at):
    suite_data["agents"] = [PPO, {"name": "paper_servo"}]
    suite_data["scenarios"][0] |= {"motions": 88, "perturbations": [{"at": at, "do": AIM}]}
    seen, recorders = {}, []
    for recorder in (LifetimeRecorder, RowsRecorder):
        monkeypatch.setattr(worker, recorder.__name__, watched(recorder, recorders))
    for spec in runs(suite_data):
        outcome, rows = lived(spec, tmp_path)
        train = [row for row in rows if row["phase"] == "train"]
        assert [row["trial"] for row in train] == list(range(len(train)))
        assert len(train) >= 2
        applied = [what for _, _, what in outcome["perturbations"]]
        seen.setdefault(spec.world, []).append((recorders[-1].worlds, applied, outcome["met"]))
        assert max(row["lifetime_motions"] for row in rows) == 88
    for ppo, servo in seen.values():
        assert ppo == servo
        assert len(ppo[0]) == 2
    assert seen[0][0][2] != seen[1][0][2]


def test_every_row_is_in_the_same_world_with_an_object_of_its_own():
    recorder = recorded()
    arms = recorder.env.unwrapped
    single = ENV.make().unwrapped
    single.reset(seed=5)
    assert all(world == single.world for world in arms.worlds)
    objects = recorder.reset()[0]["desired_goal"]
    assert len(np.unique(objects, axis=0)) == 4
    np.testing.assert_array_equal(objects[0], single.reset(seed=5)[0]["desired_goal"])


def test_an_event_is_applied_once_the_summed_motions_reach_it_to_all_rows():
    schedule = ({"at": {"motion": 9}, "do": AIM}, {"at": {"motion": 12}, "do": AIM})
    recorder = recorded(schedule=schedule)
    single = LifetimeRecorder(ENV.make(schedule), 5)
    for _ in range(5):
        recorder.step(words(4))
    for _ in range(20):
        single.step(words(1)[0])
    assert [(motions, what) for motions, _, what in recorder.perturbations] == [
        (12, what) for _, _, what in single.perturbations
    ]
    assert [motions for motions, _, _ in single.perturbations] == [9, 12]
    assert recorder.since_perturbation == 8
    assert all(world == recorder.world == single.world for world in recorder.env.unwrapped.worlds)


def test_a_drift_goes_as_far_as_that_of_a_single_environment():
    schedule = ({"drift": {"per": "motion"}, "do": {**AIM, "degrees": 0.01}},)
    recorder, single = recorded(schedule=schedule), LifetimeRecorder(ENV.make(schedule), 5)
    for _ in range(4):
        recorder.step(words(4))
    for _ in range(13):  # the world of the rows' last motions is that at their 12th
        single.step(words(1)[0])
    assert recorder.world == single.world
    assert len(recorder.perturbations) == len(single.perturbations) == 1


def test_a_lifetime_of_rows_may_begin_perturbed():
    recorder = recorded(schedule=({"at": {"trial": 0}, "do": AIM},))
    single = LifetimeRecorder(ENV.make(({"at": {"trial": 0}, "do": AIM},)), 5)
    assert recorder.perturbations == single.perturbations
    assert recorder.world == single.world == recorder.env.unwrapped.worlds[3]


def test_records_are_those_of_single_environments():
    """Row by row, with the same words: a trial's length, truth, and the way home."""
    log: list[TrialRecord] = []
    recorder = recorded(2, on_trial=log.append, tolerance_px=60.0)
    config = ENV.model_copy(update={"tolerance_px": 60.0})
    expected: list[TrialRecord] = []
    made = config.make().unwrapped
    made.reset(seed=5)
    singles = []
    for row in range(2):
        env = config.make()
        env.unwrapped.set_world(made.world)
        singles.append(LifetimeRecorder(env, 5 + row, expected.append))
    observation, _ = recorder.reset()
    now = [single.reset()[0] for single in singles]
    for step in range(20):
        chosen = words(2, step)
        for row, single in enumerate(singles):
            np.testing.assert_array_equal(observation["desired_goal"][row], now[row]["desired_goal"])
            now[row], _, terminated, truncated, _ = single.step(chosen[row])
            if terminated or truncated:
                now[row], _ = single.reset()
        observation, _, terminated, truncated, infos = recorder.step(chosen)
        if (terminated | truncated).any():
            assert infos["_final_obs"].tolist() == (terminated | truncated).tolist()
    assert len(log) >= 4
    assert [record.trial for record in log] == list(range(len(log)))
    for ours, theirs in zip(log, expected, strict=True):
        for name in ("motions", "robot_seconds", "success", "rendezvous", "error_px", "distance_mm"):
            assert ours[name] == pytest.approx(theirs[name], rel=1e-6), name
        assert ours.motions_to == theirs.motions_to


def test_a_reset_begins_no_trial_twice():
    recorder = recorded()
    first = recorder.reset()[0]["desired_goal"]
    np.testing.assert_array_equal(recorder.reset()[0]["desired_goal"], first)
    recorder.step(words(4))
    assert not np.array_equal(recorder.reset()[0]["desired_goal"], first)
    assert (recorder.motions, recorder.trials) == (4, 0)
    assert recorder.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    with pytest.raises(ValueError, match="it takes none"):
        recorder.reset(options={"object": (0, 0, 0)})


def test_lifetimes_counted_in_trials_are_refused():
    """The first trials to end are the short ones: among them even random words look good."""
    agent = AgentConfig.model_validate(PPO)
    in_trials = ScenarioConfig(name="short", env=ENV, trials=5)
    assert "count motions, or set rows: 1" in unfit_life(in_trials, agent, None, 4)["trials"]
    assert unfit_life(ScenarioConfig(name="short", env=ENV, motions=8), agent, None, 4) == {}


@pytest.mark.parametrize(
    ("config", "do"),
    [
        (
            {"id": "CalFree/SafeReach-v0", "camera_mount": "waist"},
            {"type": "camera_replace", "camera": "left"},
        ),
        ({"id": "CalFree/DockDense-v0"}, {"type": "camera_aim", "camera": "front", "degrees": 15}),
    ],
)
def test_perturbations_are_judged_as_the_environment_judges_them(config, do):
    """Where walls and table may hide what cameras would see, or a dock is out of view, other draws serve."""
    config = EnvironmentConfig(world="wild", **config)
    schedule = ({"at": {"trial": 0}, "do": do},)
    rows = RowsRecorder(config, 2, (), schedule, 20)
    single = LifetimeRecorder(config.make(schedule), 20)
    assert rows.world == single.world


@pytest.mark.parametrize("when", [{"at": {"trial": 0}}, {"drift": {"per": "motion"}}], ids=str)
def test_where_a_trial_could_not_begin_rows_meet_the_draw_that_a_single_arm_meets(when):
    """In world 27 the first zero that is drawn leaves the arm touching something at home."""
    safe = EnvironmentConfig(id="CalFree/SafeReach-v0", world="wild", camera_mount="waist")
    schedule = ({**when, "do": {"type": "joint_zero"}},)
    rows = RowsRecorder(safe, 2, (), schedule, 27)
    single = LifetimeRecorder(safe.make(schedule), 27)
    for _ in range(3):
        rows.step(np.zeros((2, 3)))
    for _ in range(5):
        single.step(np.zeros(3))
    assert rows.world == single.world
    assert rows.env.unwrapped.worlds == [rows.world, rows.world]
    home = rows.env.unwrapped.arms.motors.joints(np.zeros((2, 3)), slice(None))
    np.testing.assert_array_equal(home[0], home[1])


def test_rows_in_a_new_world_each_trial_are_refused():
    agent = AgentConfig.model_validate(PPO)
    assert requirements(agent, ENV).rows == 4
    with pytest.raises(ValueError, match="learns from 4 rows in one world; redraw is 'trial'"):
        requirements(agent, ENV.model_copy(update={"redraw": "trial"}))
