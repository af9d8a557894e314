"""A kept benchmark is a page to read."""

import json

import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.errors import ConfigError
from experiments.reporting import kept_tables
from experiments.reporting.keep import keep_benchmark
from experiments.reporting.tables import Table


@pytest.fixture
def measured(tmp_path):
    """What `benchmark --out` wrote."""
    frame = pd.DataFrame({"agent": ["memory"], "success": [0.9876], "success, 95 %": ["[95.0, 99.9] %"]})
    table = Table("rolled", "Rolled by 20°", frame, {"success": ".1%"}, "A note.")
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"commit": "abc", "versions": {}, "tables": [table.to_dict()]}))
    return path


def test_the_page_has_every_table_with_intervals_beside_numbers(measured, tmp_path, monkeypatch):
    monkeypatch.setattr(kept_tables, "KEPT", tmp_path / "kept")
    assert main(["keep", str(measured)]) == 0
    folder = tmp_path / "kept" / "mine"
    assert (folder / "mine.json").read_bytes() == measured.read_bytes()
    assert (folder / "report.md").read_text() == (
        "# mine\n\nCode of commit abc.\n\n## Rolled by 20°\n\n"
        "| agent | success |\n| --- | --- |\n| memory | 98.8 % [95.0, 99.9] % |\n\nA note.\n"
    )
    assert keep_benchmark(folder / "mine.json", tmp_path / "kept") == folder, "what is kept is written anew"


def test_what_is_no_benchmark_is_refused(measured, tmp_path):
    kept = tmp_path / "kept"
    with pytest.raises(ConfigError, match=r"other\.json: there is no such file"):
        keep_benchmark(tmp_path / "other.json", kept)
    (kept / "mine").mkdir(parents=True)
    (kept / "mine" / "results.parquet").write_text("")
    with pytest.raises(ConfigError, match="holds the results of a suite"):
        keep_benchmark(measured, kept)
    measured.write_text("{}")
    with pytest.raises(ConfigError, match="damaged or no kept result"):
        keep_benchmark(measured, kept)


def test_every_kept_benchmark_has_its_page():
    for path in kept_tables.KEPT.glob("*/*.json"):
        assert path.with_name("report.md").exists(), path
