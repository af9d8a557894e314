"""One run, made in this process: what is the same for every agent, and what evaluation changes."""

from zipfile import ZipFile

import numpy as np
import pytest

from experiments.running import worker
from experiments.running.lifetime import LifetimeRecorder
from tests.agents.neural.quick import QUICK
from tests.experiments.fakes import AIM as TURN
from tests.experiments.fakes import lived, runs, watched

AGENTS = [
    {"name": "random"},
    {"name": "unified_servo"},
    {"name": "grid_table"},
    {"name": "sac", "settings": {**QUICK["sac"], "learning_starts": 10}},
]
AIM = {"type": "camera_aim", "camera": "left"}  # by how much is drawn


@pytest.fixture
def run_all(suite_data, tmp_path, monkeypatch):
    """Makes every run of the suite, and returns its spec, its recorder and its rows."""

    class Watched(LifetimeRecorder):
        """Keeps the objects that its agent meets, too."""

        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.objects = []

        def reset(self, **arguments):
            observation, info = super().reset(**arguments)
            if not (self.objects and np.array_equal(self.objects[-1], info["truth"]["object"])):
                self.objects.append(info["truth"]["object"])
            return observation, info

    def make():
        recorders = []
        monkeypatch.setattr(worker, "LifetimeRecorder", watched(Watched, recorders))
        specs = runs(suite_data)
        rows = [lived(spec, tmp_path)[1] for spec in specs]
        return list(zip(specs, recorders, rows, strict=True))

    return make


@pytest.mark.parametrize("at", [{"trial": 3}, {"motion": 40}], ids=str)
def test_every_agent_meets_the_same_worlds_trials_and_perturbations(suite_data, run_all, at):
    suite_data["agents"] = AGENTS
    suite_data["scenarios"][0]["perturbations"] = [{"at": at, "do": AIM}]
    recorders = run_all()
    for world in range(suite_data["worlds"]):
        ours = [recorder for spec, recorder, _ in recorders if spec.world == world]
        assert len(ours) == len(AGENTS)
        assert all(recorder.worlds == ours[0].worlds for recorder in ours)
        assert len(ours[0].worlds) == 2
        if "trial" in at:  # else some agents meet trial t before the perturbation, others after it
            common = min(len(recorder.objects) for recorder in ours)
            assert common > 3
            for recorder in ours:
                np.testing.assert_array_equal(recorder.objects[:common], ours[0].objects[:common])
    assert recorders[0][1].worlds[0] != recorders[1][1].worlds[0]


def test_checkpoints_are_the_same_for_agents_that_reset_at_once(suite_data, run_all, monkeypatch):
    """Stable-baselines3 resets before its callback, a servo after it: the perturbation waits for neither."""
    suite_data |= {"worlds": 1, "agents": [AGENTS[1], AGENTS[3]]}
    suite_data["scenarios"][0]["perturbations"] = [{"at": {"trial": 2}, "do": AIM}]
    suite_data["scenarios"][0]["env"]["tolerance_px"] = 0.01  # never reached: trial 2 begins after 40 motions
    worlds, evaluate = [], worker.evaluate

    def noted(agent, env, trials, seed):
        worlds.append(env.unwrapped.world)
        return evaluate(agent, env, trials, seed)

    monkeypatch.setattr(worker, "evaluate", noted)
    recorders = run_all()
    for _, _, rows in recorders:
        held_out = [row for row in rows if row["phase"] == "eval" and row["trial"] == 0]
        made = [(row["lifetime_motions"], row["motions_since_perturbation"]) for row in held_out]
        assert made == [(0, None), (40, None), (40, 0), (80, 40), (90, 50)]
    assert worlds[:5] == worlds[5:]
    assert worlds[1] == worlds[0] != worlds[2] == worlds[4]
    assert recorders[0][1].perturbations == recorders[1][1].perturbations


@pytest.mark.parametrize("agent", AGENTS, ids=lambda agent: agent["name"])
def test_evaluation_changes_nothing_in_the_agent(suite_data, run_all, agent):
    suite_data |= {"worlds": 1, "agents": [agent]}
    trials = []
    for every in (20, 90):
        suite_data["evaluation"]["every"] = every
        ((_, _, rows),) = run_all()
        trials.append([row for row in rows if row["phase"] == "train"])
    assert len(trials[0]) >= 4
    assert trials[0] == trials[1]


PPO = {"name": "ppo", "settings": {**QUICK["ppo"], "rows": 4}, "motions": 160}
SAC = AGENTS[3]


@pytest.fixture
def live(suite_data, tmp_path, monkeypatch):
    """Makes the first run of the suite; returns its checkpoints, and the world and knowledge at each."""

    def make(agent, **changes):
        seen, evaluate = [], worker.evaluate

        def watched(timed, env, trials, seed):
            timed.agent.save(tmp_path / "agent")
            with ZipFile(tmp_path / "agent") as saved:  # whose bytes tell the time, too
                seen.append((env.unwrapped.world, {name: saved.read(name) for name in saved.namelist()}))
            return evaluate(timed, env, trials, seed)

        monkeypatch.setattr(worker, "evaluate", watched)
        (spec,) = runs(suite_data, agents=[agent], worlds=1, evaluation={"trials": 1, **changes})
        held_out = [row for row in lived(spec, tmp_path)[1] if row["phase"] == "eval"]
        return [(row["lifetime_motions"], row["motions_since_perturbation"]) for row in held_out], seen

    return make


@pytest.mark.parametrize("agent", ["grid_table", SAC, PPO], ids=str)
def test_nothing_is_learned_between_the_checkpoints_around_a_perturbation(suite_data, live, agent):
    suite_data["scenarios"][0] |= {"motions": 160, "perturbations": [{"at": {"share": 0.5}, "do": TURN}]}
    made, seen = live(agent, per_decade=1)
    first, again = (0, 4, 12, 100) if agent is PPO else (0, 1, 10, 100), (4, 12) if agent is PPO else (1, 10)
    assert made == [
        *((at, None) for at in (*first[:3], 80)),
        (80, 0),
        (80 + again[0], again[0]),
        (80 + again[1], again[1]),
        (100, 20),
        (160, 80),
    ]
    before, after = made.index((80, None)), made.index((80, 0))
    assert seen[before][1] == seen[after][1]
    assert seen[before][0] == seen[0][0] != seen[after][0] == seen[-1][0]


def test_from_the_trial_of_a_perturbation_checkpoints_of_rows_are_counted_anew(suite_data, live):
    suite_data["scenarios"][0]["perturbations"] = [{"at": {"trial": 2}, "do": TURN}]
    suite_data["scenarios"][0]["env"]["tolerance_px"] = 0.01  # never reached: 4 trials end at 80 motions
    made, _ = live(PPO, at=[0, 8])
    assert made == [(0, None), (8, None), (80, None), (80, 0), (88, 8), (160, 80)]


def test_each_of_several_perturbations_has_its_own_stretch(suite_data, live):
    suite_data["scenarios"][0] |= {
        "motions": 60,
        "perturbations": [{"at": {"share": 0.25}, "do": TURN}, {"at": {"motion": 30}, "do": TURN}],
    }
    made, seen = live("random", at=[0, 5])
    assert made == [(0, None), (5, None), (15, None), (15, 0), (20, 5), (30, 15), (30, 0), (35, 5), (60, 30)]
    assert seen[5][0] != seen[6][0]


def test_a_world_that_changes_again_and_again_is_no_long_evaluation(suite_data, live):
    suite_data["scenarios"][0]["perturbations"] = [{"every": {"motion": 10}, "do": TURN}]
    made, _ = live("random", every=40)
    assert made == [(0, None), (10, None), (10, 0), (40, 10), (40, 0), (80, 10), (80, 0), (90, 10)]


@pytest.mark.parametrize("once", [{"motion": 55}, {"trial": 3}], ids=str)
def test_a_change_that_comes_once_among_those_that_come_again_is_seen_from_both_sides(suite_data, live, once):
    suite_data["scenarios"][0]["perturbations"] = [
        {"every": {"motion": 10}, "do": TURN},
        {"at": once, "do": TURN},
    ]
    suite_data["scenarios"][0]["env"] |= {"tolerance_px": 0.01, "max_episode_steps": 15}  # never reached
    at = once.get("motion", 45)
    made, _ = live("random", every=90)
    assert made[:3] == [(0, None), (10, None), (10, 0)]
    assert made[3:] == [(at, 5), (at, 0), (at + 5, 5), (at + 5, 0), (90, 10)]
