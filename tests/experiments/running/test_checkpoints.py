"""Held-out trials around a perturbation: the same agent, in the old world and in the new one."""

from zipfile import ZipFile

import pytest

from experiments.running import worker
from tests.agents.neural.quick import QUICK
from tests.experiments.fakes import AIM, lived, runs

PPO = {"name": "ppo", "settings": {**QUICK["ppo"], "rows": 4}, "motions": 160}
SAC = {"name": "sac", "settings": {**QUICK["sac"], "learning_starts": 10}}


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
    suite_data["scenarios"][0] |= {"motions": 160, "perturbations": [{"at": {"share": 0.5}, "do": AIM}]}
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


def test_each_of_several_perturbations_has_its_own_stretch(suite_data, live):
    suite_data["scenarios"][0] |= {
        "motions": 60,
        "perturbations": [{"at": {"share": 0.25}, "do": AIM}, {"at": {"motion": 30}, "do": AIM}],
    }
    made, seen = live("random", at=[0, 5])
    assert made == [(0, None), (5, None), (15, None), (15, 0), (20, 5), (30, 15), (30, 0), (35, 5), (60, 30)]
    assert seen[5][0] != seen[6][0]


def test_a_world_that_changes_again_and_again_is_no_long_evaluation(suite_data, live):
    suite_data["scenarios"][0]["perturbations"] = [{"every": {"motion": 10}, "do": AIM}]
    made, _ = live("random", every=40)
    assert made == [(0, None), (10, None), (10, 0), (40, 10), (40, 0), (80, 10), (80, 0), (90, 10)]
