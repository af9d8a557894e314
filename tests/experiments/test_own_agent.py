"""An agent that stands in a user's own module: by name, in suites, and what is said where it is not found."""

import importlib
import re
import sys

import gymnasium as gym
import pandas as pd
import pytest

import agents
from agents.base.registration import AGENTS
from experiments.__main__ import main
from experiments.config.environment import EnvironmentConfig
from experiments.config.loading import load
from experiments.config.own_agents import code_of
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.errors import ConfigError
from experiments.running.run import parse_run
from tests.experiments.fakes import ids, runs

SOURCE = '''
from agents.base.registration import agent
from agents.reference.bounds import RandomAgent
{more}

@agent({name!r}, "Moves at random.")
class Own(RandomAgent):
    """Ours under another name."""
'''


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes `lab/servo.py` in the current folder, as a user would have changed it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    (tmp_path / "lab").mkdir()

    def forget():
        AGENTS.pop("own", None)
        for module in ("lab.servo", "lab"):
            sys.modules.pop(module, None)
        importlib.invalidate_caches()
        code_of.cache_clear()

    def write(name="own", more=""):
        forget()
        (tmp_path / "lab" / "servo.py").write_text(SOURCE.format(name=name, more=more))

    yield write
    forget()


def test_it_takes_part_as_its_class_and_its_results_are_read_without_it(
    write, suite_data, write_config, tmp_path, capsys
):
    write()
    suite_data["agents"] = ["random", "lab.servo:own"]
    out = tmp_path / "out"
    assert main(["run", str(write_config(suite_data)), "--out", str(out), "--import", "lab"]) == 0
    results = pd.read_parquet(out / "results.parquet")
    ours, own = (
        results[results["agent"] == label].drop(columns=["agent", "run"]) for label in ("random", "own")
    )
    measured = [column for column in ours if "seconds" not in column]
    pd.testing.assert_frame_equal(ours[measured].reset_index(drop=True), own[measured].reset_index(drop=True))
    before = (out / "report.md").read_text()

    write(more="raise RuntimeError('imported')")
    for source in (out, out / "results.parquet"):
        assert main(["report", str(source), "--out", str(tmp_path / "again")]) == 0
        assert (tmp_path / "again" / "report.md").read_text() == before
    assert main(["status", str(out)]) == 0
    assert "lab.servo" not in sys.modules
    told = (out / "suite.json").read_text()
    (out / "suite.json").write_text(told.replace("lab.servo:own", "<b>:own"))
    assert main(["status", str(out)]) == 2
    assert "allowed: my_module:my_agent" in capsys.readouterr().err


def test_its_runs_are_made_anew_where_its_package_changes(write, suite_data, tmp_path):
    write()
    suite_data["agents"] = ["random", "lab.servo:own"]
    before = ids(suite_data)
    ordered = next(run for run in runs(suite_data) if run.agent.label == "own").model_dump_json()
    assert parse_run(ordered).id in before
    write(more="from lab import gain")
    (tmp_path / "lab" / "gain.py").write_text("GAIN = 1.0")
    after = ids(suite_data)
    with pytest.raises(ValueError, match="own' is other code here"):
        parse_run(ordered)
    (tmp_path / "lab" / "gain.py").write_text("GAIN = 2.0")
    write(more="from lab import gain")
    last = ids(suite_data)
    own = [run for run in (*before, *after, *last) if "-own-" in run]
    assert len({*own}) == len(own) == 6
    assert {*before} & {*after} & {*last} == {run for run in before if "-random-" in run}


def test_what_an_own_agent_must_know_is_nothing_only_where_it_says_so(write):
    env = EnvironmentConfig(id="CalFree/Reach-v0", world="nominal")
    for told, known in (
        ("", ("not declared",)),
        ("prior_knowledge = frozenset()", ()),
        ("prior_knowledge = frozenset({PriorKnowledge.NOISE})", ("noise",)),
    ):
        imported = "from agents.base.prior_knowledge import PriorKnowledge"
        write(more=f"{imported}\nRandomAgent = type('Base', (RandomAgent,), dict({told}))")
        found = requirements(AgentConfig.model_validate("lab.servo:own", context=["lab"]), env)
        assert found.prior_knowledge == known


def test_a_module_is_what_it_imports_from_its_folder_and_a_package_its_weights(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "alone.py").write_text("import numpy, agents\n\ndef later():\n    from helping import gain")
    (tmp_path / "helping.py").write_text("import other.part")
    (tmp_path / "other").mkdir()
    written = [tmp_path / "other" / name for name in ("__init__.py", "part.py", "net.pt")]
    written += [tmp_path / "helping.py", tmp_path / "alone.py"]
    found = []
    for path in (None, *written, tmp_path / "unrelated.py"):
        if path:
            path.write_text(f"{path.read_text() if path.exists() else ''}\n# more")
        importlib.invalidate_caches()
        code_of.cache_clear()
        found.append(code_of("alone"))
    assert len({*found}) == len(found) - 1
    assert found[-1] == found[-2]


@pytest.mark.parametrize(
    ("name", "asked", "said"),
    [
        ("own", "lab.servo:owm", "unknown agent 'lab.servo:owm' (did you mean own?)"),
        ("own", "lab.sevo:own", "Python finds no module 'lab.sevo'"),
        ("own", "no_lab.servo:own", "Python finds no module 'no_lab'"),
        ("own", ".servo:own", "'.servo' is no name of a module; allowed: my_module:my_agent"),
        (
            "random",
            "lab.servo:random",
            "'random' is <class 'agents.reference.bounds.RandomAgent'> already",
        ),
    ],
)
def test_what_is_not_found_or_taken_is_told(write, write_config, suite_data, name, asked, said):
    write(name)
    with pytest.raises(ValueError, match=re.escape(said)):
        agents.make(asked, gym.make("CalFree/Reach-v0"))
    suite_data["agents"] = ["random", asked]
    with pytest.raises(ConfigError, match=re.escape(said)) as error:
        load(write_config(suite_data), (), [asked.rpartition(":")[0]])
    assert "agents.1.name" in str(error.value)


def test_a_suite_imports_only_what_its_user_trusts(write, write_config, suite_data, refused):
    write()
    suite_data["agents"] = ["random", "lab.servo:own"]
    said = (
        "agents.1.name: found 'lab.servo:own': its module is not imported unless you say --import lab.servo"
    )
    assert said in refused(suite_data)
    for others in (["la"], ["servo"], ["lab.servo.more"]):
        with pytest.raises(ConfigError, match=re.escape(said)):
            load(write_config(suite_data), (), others)
    assert "lab" not in sys.modules
    for trusted in ("lab", "lab.servo"):
        assert load(write_config(suite_data), (), [trusted]).agents[1].label == "own"


def test_what_its_module_lacks_is_no_missing_agent(write):
    write(more="import no_such_package")
    with pytest.raises(ModuleNotFoundError, match="No module named 'no_such_package'"):
        agents.named("lab.servo:own")


def test_its_module_may_run_twice(write):
    write()
    first = agents.named("lab.servo:own").kind
    importlib.reload(sys.modules["lab.servo"])
    assert agents.named("lab.servo:own").kind is not first
