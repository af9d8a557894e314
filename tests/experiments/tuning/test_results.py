"""What is published: files, tables in pages, and settings for configs/agents."""

import json

import pytest
import yaml

from experiments.errors import ConfigError
from experiments.reporting.kept_tables import tables_named
from experiments.tuning.command import SETTINGS, settings_file, write_agent, write_tables
from experiments.tuning.config import TuningConfig
from tests.experiments.tuning.conftest import KnownLifetimes, quadratic


@pytest.fixture
def kept(tune, tuning_data, tmp_path):
    """Results of one agent, kept."""
    folder = tmp_path / "results" / "tuning"
    folder.mkdir(parents=True)
    write_agent(folder, tune(KnownLifetimes(quadratic, cpu_seconds=3.0)))
    write_tables(folder, TuningConfig.model_validate(tuning_data))
    return folder


def test_pages_show_the_choice_its_cost_and_the_ranges(kept):
    published = json.loads((kept / "jacobian_servo.json").read_text())
    text = tables_named("tuning/choices", kept.parent)
    best, difference = published["best"]["damping"], published["check"]["difference"]
    minutes = published["cpu_minutes"]
    default = published["tries"][0]["objective"]
    least = min(each["objective"] or 99 for each in published["tries"])
    row = " | ".join(line for line in text.splitlines() if line.startswith("| `jacobian_servo`"))
    assert f"| `jacobian_servo` | 20 | {minutes:.1f} | {default:.2f} | " in row
    assert f" | {least:.2f} | 4 | " in row
    said = f"{difference['value']:.2f} [{difference['low']:.2f}, {difference['high']:.2f}]"
    assert f" | {said} |" in row
    assert row.endswith("| 0.4 | tuned | 20 tries |")
    assert "code of commit commit" in text
    ranges = tables_named("tuning/ranges", kept.parent)
    assert "| `jacobian_servo` | `damping` | 0.001 to 1, by factors | 0.05 |" in ranges
    assert f"| `jacobian_servo` | {best} | {best} |" in ranges
    tries = tables_named("tuning/jacobian_servo", kept.parent)
    assert f"| 0 | 0.05 | {default:.2f} |" in tries
    assert "| 0 | 6.0 | complete |" in tries
    assert (kept / "report.md").read_text().count("\n## ") == 2


def published(name, settings):
    return {"agent": {"name": name}, "settings": settings}


def test_better_settings_become_the_file_of_an_agent_that_has_none(tmp_path):
    text = settings_file(published("jacobian_servo", {"damping": 1e-05, "estimator": "rls"}), tmp_path)
    assert yaml.safe_load(text) == {"damping": 1e-05, "estimator": "rls"}
    assert text.startswith("# jacobian_servo: tuned, see experiments/results/tuning/jacobian_servo.json")


def test_better_settings_replace_those_in_a_file_and_leave_the_rest_of_it():
    before = (SETTINGS / "sac.yaml").read_text()
    text = settings_file(published("sac", {"gamma": 0.3, "train_freq": 2, "tau": 0.01}))
    assert yaml.safe_load(text) == yaml.safe_load(before) | {"gamma": 0.3, "train_freq": 2, "tau": 0.01}
    assert "gamma: 0.3  # a dense reward tells at once\n" in text
    assert set(before.splitlines()) - set(text.splitlines()) == {
        "gamma: 0.5  # a dense reward tells at once",
        "train_freq: 4",
    }


def test_a_setting_over_several_lines_is_named(tmp_path):
    (tmp_path / "sac.yaml").write_text("gamma:\n  0.5\n")
    with pytest.raises(ConfigError, match="gamma over several lines"):
        settings_file(published("sac", {"gamma": 0.3}), tmp_path)
