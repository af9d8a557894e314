"""A sweep: every agent at every value, in the same worlds, given what it requires and no more."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.config.environment import EnvironmentConfig
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig, Suite, SweepConfig
from experiments.reporting.finished_suite import FinishedSuite, with_cost
from experiments.reporting.sweep import points, sweep_figure, sweep_sections, swept
from experiments.running import worker
from experiments.running.run import parse_run, runs_of
from tests.arms.own import MODELS
from tests.experiments.fakes import ids, lived, runs

ENV = {"id": "CalFree/Reach-v0", "world": "nominal", "dynamics": "kinematic", "keep_in_view": False}
ROLL = {"name": "roll", "env": ENV, "do": {"type": "camera_roll", "camera": "left"}, "vary": "degrees"}
ZERO = {"do": {"type": "joint_zero", "joint": "J1"}, "vary": "degrees"}
HOBBY = {"model": str(MODELS / "hobby.xml"), "gripper": "tip"}
AIM = {"name": "aim", "env": ENV, "do": {"type": "camera_aim", "camera": "left"}, "vary": "degrees"}


@pytest.fixture
def sweep_data(suite_data):
    del suite_data["scenarios"]
    suite_data["sweeps"] = [{**ROLL, "over": [0, 90]}]
    return suite_data


@pytest.fixture
def rows_of(tmp_path):
    """Makes a suite's runs in this process, and returns the rows of each by its agent."""

    def make(data):
        return {run.agent.label: pd.DataFrame(lived(run, tmp_path)[1]) for run in runs(data)}

    return make


@pytest.mark.parametrize(
    ("change", "where", "said"),
    [
        ({"vary": "degres"}, "sweeps.0.vary: found 'degres'", "did you mean degrees?"),
        ({"do": {"type": "camera_roll"}, "vary": "camera"}, "sweeps.0.vary", "allowed: degrees"),
        ({"do": {"type": "camera_rol"}}, "sweeps.0.do.type is 'camera_rol'", "did you mean camera_roll"),
        ({"do": {"type": "camera_roll", "angle": 3}}, "sweeps.0.do: found", "camera_roll allows"),
        ({"do": {"type": "camera_roll", "degrees": 3}}, "sweeps.0.vary", "do gives degrees already"),
        ({"do": {"type": "point_outliers"}, "vary": "share", "over": [0, 2]}, "sweeps.0.over.1", "0 to 1"),
        ({"do": {"type": "latency"}, "vary": "motions", "over": [0.5]}, "sweeps.0.over.0", "a whole number"),
        ({"over": [0, 90, 45]}, "sweeps.0.over: found", "must ascend"),
        ({"over": [90, 90]}, "sweeps.0.over: found", "must ascend"),
        ({"over": []}, "sweeps.0.over", "at least 1"),
        ({"over": [True]}, "sweeps.0.over.0", "found True"),
        ({"ovr": [0]}, "sweeps.0.ovr: unknown key", "did you mean over?"),
        ({"env": {**ENV, "arm": HOBBY}, **ZERO}, "sweeps.0: joint_zero.joint is 'J1'", "allowed: turn"),
        ({"env": {**ENV, "world": "wilt"}}, "sweeps.0.env.world", "did you mean wild or wilder?"),
    ],
)
def test_errors_say_where_what_and_what_else(sweep_data, refused, change, where, said):
    sweep_data["sweeps"][0] |= change
    found = refused(sweep_data)
    assert f"\n  {where}" in found
    assert said in found


def test_no_sweep_is_called_as_another_or_as_a_scenario(sweep_data, refused):
    again = {"scenarios": [{"name": "roll", "env": ENV, "motions": 1000}]}
    for twice in ({"sweeps": 2 * sweep_data["sweeps"]}, again):
        assert "name roll stands twice" in refused(sweep_data | twice)


def test_whatever_changes_a_sweep_changes_its_runs_and_nothing_else_does(sweep_data):
    known = ids(sweep_data)
    assert len(set(known)) == 2
    assert [parse_run(run.model_dump_json()) for run in runs(sweep_data)] == runs(sweep_data)
    assert ids(sweep_data, evaluation={"every": 7, "trials": 7}, question="Else?") == known
    assert ids(sweep_data, sweeps=[*sweep_data["sweeps"], {**AIM, "over": [1]}])[:2] == known
    for change in ({"seed": 5}, {"worlds": 3}, {"sweeps": [{**ROLL, "over": [0, 91]}]}):
        assert not {*ids(sweep_data, **change)} & {*known}


def test_all_agents_meet_the_same_worlds_objects_and_observations(sweep_data, rows_of, monkeypatch):
    evaluate, met = worker.evaluate, {}

    def watched(agent, env, trials, seed):
        observation, info = env.reset(seed=seed)
        met.setdefault(agent.agent.kind.split("(")[0], []).append(
            (observation, info["truth"], env.unwrapped.world)
        )
        return evaluate(agent, env, trials, seed)

    monkeypatch.setattr(worker, "evaluate", watched)
    sweep_data["agents"] = ["random", "joint_space_servo", "affine_stereo"]
    rows_of(sweep_data)
    random, joints, affine = met.values()
    for (one, _, _), (two, _, _), (three, _, _) in zip(random, joints, affine, strict=True):
        for key in one:
            np.testing.assert_array_equal(one[key], two[key])
            np.testing.assert_array_equal(one[key], three[key])
        assert set(two) - set(one) == {"joint_angles"}
        assert set(three) - set(one) == {"gripper_position"}
    straight, turned = random[:2], random[2:]
    for (_, truth, world), (_, truth_turned, rolled) in zip(straight, turned, strict=True):
        np.testing.assert_array_equal(truth["object"], truth_turned["object"])
        cosine = np.abs(np.sum(world.camera_orientation * rolled.camera_orientation, axis=1))
        np.testing.assert_allclose(np.degrees(2 * np.arccos(np.minimum(cosine, 1))), [90, 0], atol=1e-5)
        # A roll by 90 degrees takes x, y in the left image (about its centre) to -y, x or y, -x.
        left, left_turned = truth["points"].reshape(4, 2)[0], truth_turned["points"].reshape(4, 2)[0]
        assert abs(left @ left_turned) < 1e-9
        assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(left_turned))
    assert not np.array_equal(straight[0][1]["object"], straight[1][1]["object"])


def test_out_of_view_is_where_a_camera_does_not_look_and_the_same_for_all(sweep_data, rows_of):
    sweep_data |= {"worlds": 12, "agents": ["random", "model_based"]}
    sweep_data["sweeps"] = [{**AIM, "env": {**ENV, "max_episode_steps": 2}, "over": [0, 30]}]
    (run, _) = runs(sweep_data)
    env = run.sweep.env.make(run.sweep.perturbations(30))
    within = [np.abs(env.reset(seed=seed)[1]["truth"]["points"]).max() <= 1 for seed in run.world_seeds]
    assert 0 < sum(within) < 12
    found = rows_of(sweep_data)
    for rows in found.values():
        assert list(rows["in_view"]) == [True] * 12 + within
        assert list(rows["value"]) == [0] * 12 + [30] * 12
        assert list(rows["world"]) == [*range(12)] * 2


def test_points_that_are_lost_are_in_view():
    env = EnvironmentConfig(**ENV).make(
        ({"at": {"trial": 0}, "do": {"type": "point_dropout", "share": 0.9}},)
    )
    seen = EnvironmentConfig(**ENV).make()
    found = [[worker._in_view(each, seed) for seed in range(20)] for each in (env, seen)]
    assert found[0] == found[1]
    assert any(found[0])


def test_an_agent_gets_what_it_requires():
    env = EnvironmentConfig(**ENV, camera_mount="stand")
    wanted = requirements(AgentConfig(name="joint_space_servo", label="a"), env)
    assert wanted[:3] == (("joint_angles",), {}, 1)
    for name in ("model_based", "self_calibrating"):
        wanted = requirements(AgentConfig(name=name, label="a"), env)
        assert wanted[:3] == ((), {"camera_mount": "stand"}, 1)
    wrong = AgentConfig(name="model_based", label="a", settings={"camera_mount": "waist"})
    assert requirements(wrong, env).settings == {"camera_mount": "waist"}
    with pytest.raises(ValueError, match="did you mean camera_mount"):
        requirements(AgentConfig(name="model_based", label="a", settings={"camera_mont": "waist"}), env)


def table(*rows):
    """From (agent, value, world, in view, success, motions)."""
    names = ["agent", "value", "world", "in_view", "success", "motions"]
    data = pd.DataFrame(rows, columns=names).assign(scenario="roll", distance_mm=1.0)
    return data.assign(rendezvous=data["success"], error_px=np.where(data["success"], 1.0, 30.0))


def test_points_are_of_the_trials_in_view():
    data = table(
        ("servo", 0.0, 0, True, True, 1),
        ("servo", 0.0, 1, True, True, 9),
        ("servo", 0.0, 2, True, True, 4),
        ("servo", 0.0, 3, True, False, 60),
        ("servo", 0.0, 4, False, True, 50),
        ("servo", 90.0, 0, False, False, 60),
        ("servo", 180.0, 0, True, False, 60),
        *(("servo", 190.0, world, True, world == 7, 5) for world in range(11)),
    )
    of = SweepConfig(**ROLL, over=(0, 90, 180, 190))
    reached, hidden, missed, once = points(with_cost(data, of), of, "servo", 11)
    assert (reached.trials, reached.at_once) == (4, 0.25)
    assert reached.success.value == 0.75
    assert not reached.success.has_interval
    assert reached.rendezvous.value == 0.75
    assert reached.motions.value == (9 + 4) / 2
    assert reached.among_reached.value == 4
    assert hidden.trials == 0
    assert np.isnan([hidden.success.value, hidden.rendezvous.value, hidden.motions.value]).all()
    assert (missed.success.value, missed.motions.value) == (0, 60)
    assert once.success.value == pytest.approx(1 / 11)
    assert np.isnan([missed.among_reached.value, once.among_reached.value]).all()


def test_an_agent_whose_run_failed_has_reached_nothing_and_worlds_that_it_does_not_meet_are_no_failures():
    data = table(("servo", 0.0, 0, True, True, 1), ("servo", 0.0, 1, False, True, 9))
    of = SweepConfig(**ROLL, over=(0,))
    rows = with_cost(data, of)
    (failed,) = points(rows, of, "broken", 2)
    assert (failed.trials, failed.success.value, failed.motions.value) == (1, 0, 60)
    assert np.isnan(failed.among_reached.value)
    (alone,) = points(rows[:0], of, "broken", 2)
    assert (alone.trials, alone.success.value) == (2, 0)
    few = with_cost(
        table(("few", 0.0, 0, True, True, 7), *(("many", 0.0, i, True, True, 7) for i in range(3))), of
    )
    for agent, worlds in (("few", 1), ("many", 3)):
        (found,) = points(few, of, agent, worlds)
        assert (found.trials, found.rendezvous.value) == (worlds, 1)


def test_the_figure_shows_the_points():
    at_0 = (("servo", 0.0, 0, True, True, 1), ("servo", 0.0, 1, True, True, 5))
    at_90 = (("servo", 90.0, 0, True, False, 60), ("servo", 90.0, 1, False, True, 9))
    of = SweepConfig(**ROLL, over=(0, 90))
    rows = with_cost(table(*at_0, *at_90), of)
    names = {"servo": ("unified_servo", "#112233"), "random": ("random", "#445566")}
    curves = [
        (AgentConfig(name=name, label=label), points(rows, of, label, 2), {"color": colour})
        for label, (name, colour) in names.items()
    ]
    figure = sweep_figure(of, curves, "2 worlds.")
    misses, motions = figure.axes
    (line,) = misses.lines
    assert list(line.get_ydata()) == [0, 1]
    line, other, *_ = motions.lines
    assert line.get_color() == "#112233"
    assert list(line.get_ydata()) == [3, 60]
    assert list(other.get_ydata()) == [60, 60]
    assert [text.get_text() for text in motions.texts] == ["servo", "random motions"]
    assert figure.get_supxlabel() == "2 worlds. Left out on the left: random motions (no success)."
    assert "(degrees)" in misses.get_xlabel()
    plt.close(figure)


def test_a_figure_of_many_sweeps_has_a_panel_each_and_names_each_agent_once(
    sweep_data, tmp_path, monkeypatch
):
    """An agent looks the same where it is the third of one sweep, and the first of another."""
    labels, drawn = ["random", "unified_servo", "paper_servo"], {}
    monkeypatch.setattr("experiments.reporting.sweep.save", lambda fig, _, name: drawn.update({name: fig}))
    sweep_data["agents"] = labels
    sweep_data["sweeps"] = [{**ROLL, "over": [0]}, {**AIM, "over": [0], "agents": labels[2:]}]
    suite = Suite.model_validate(sweep_data)
    rows = table(*((label, 0.0, world, True, True, 3) for label in labels for world in range(2)))
    rows = pd.concat([rows.assign(scenario=name) for name in ("roll", "aim")])
    finished = FinishedSuite(tmp_path, suite, "", runs_of(suite), {}, {}, {}, rows, pd.DataFrame())
    sweep_sections(finished, [swept(finished, each) for each in suite.sweeps])
    roll, aim = drawn["_all"].axes
    assert (len(roll.lines), len(aim.lines)) == (3, 1)
    assert roll.lines[2].get_color() == aim.lines[0].get_color() == drawn["aim"].axes[1].lines[0].get_color()
    (legend,) = drawn["_all"].legends
    assert len(legend.get_texts()) == 3
    for figure in drawn.values():
        plt.close(figure)


@pytest.mark.slow
def test_from_configuration_to_report(sweep_data, write_config, tmp_path, capsys):
    sweep_data["agents"] = ["joint_space_servo", {"name": "model_based", "label": "built"}]
    sweep_data["sweeps"].append({**AIM, "over": [0, 40]})
    out = tmp_path / "out"
    config = write_config(sweep_data)
    assert main(["validate", str(config)]) == 0
    assert "2 agents, 2 sweeps, 2 worlds: 4 runs, 16 trials" in capsys.readouterr().out
    assert main(["run", str(config), "--out", str(out)]) == 0
    results = pd.read_parquet(out / "results.parquet")
    assert len(results) == 16
    assert set(results["phase"]) == {"sweep"}
    assert not results.duplicated(["scenario", "agent", "value", "world"]).any()
    for name in ("roll", "aim", "_all"):
        assert (out / "figures" / f"{name}.png").exists()
    page = (out / "report.md").read_text()
    assert "| joint_space_servo | joint_space_servo | `joint_angles`, image scale" in page
    assert "| built | model_based | image scale" in page
    of_roll = page[page.index("<summary>Sweep roll") : page.index("<summary>Sweep aim")]
    built = results[(results["agent"] == "built") & (results["value"] == 0) & (results["scenario"] == "roll")]
    assert f"| built | 0 | 100 % | {built['motions'].median():.1f} | 100 % |" in of_roll
    capsys.readouterr()
    (out / "runs" / ids(sweep_data)[0] / "DONE.json").unlink()
    assert main(["status", str(out)]) == 0
    assert "| interrupted | after 4 of 4 trials; begins anew |" in capsys.readouterr().out
