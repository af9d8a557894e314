"""What is kept of a finished suite."""

import json
import shutil

import pytest
from PIL import Image

from experiments.errors import ConfigError
from experiments.reporting.documents.keep import keep
from experiments.reporting.documents.kept_tables import tables_named
from experiments.reporting.results_file import gather


@pytest.fixture
def committed(finished_once, tmp_path):
    """Finished results that are said to be made by a commit."""
    out = shutil.copytree(finished_once, tmp_path / "out")
    return said_to_be_of(out, "0123456789ab")


def said_to_be_of(out, commit):
    about = json.loads((out / "suite.json").read_text())
    (out / "suite.json").write_text(json.dumps({**about, "commit": commit}))
    gather(out)
    return out


def test_numbers_report_and_small_figures_are_kept(committed, tmp_path):
    kept = keep(committed, tmp_path / "kept")
    assert kept == tmp_path / "kept" / "tiny"
    for name in ("results.parquet", "summary.csv", "report.md", "timings.csv"):
        assert (kept / name).read_bytes() == (committed / name).read_bytes()
    for figure in kept.glob("figures/*"):
        assert figure.stat().st_size < 0.6 * (committed / "figures" / figure.name).stat().st_size
        with Image.open(figure) as small, Image.open(committed / "figures" / figure.name) as large:
            assert small.size == large.size
    assert "0123456789ab" in tables_named("tiny/aimed", tmp_path / "kept")


def test_what_was_kept_before_is_replaced(committed, tmp_path):
    keep(committed, tmp_path / "kept")
    stale = tmp_path / "kept" / "tiny" / "stale.csv"
    stale.write_text("")
    keep(committed, tmp_path / "kept")
    assert not stale.exists()


def test_unfinished_results_are_not_kept(committed, tmp_path):
    run = next((committed / "runs").iterdir())
    shutil.rmtree(run)
    gather(committed)
    with pytest.raises(ConfigError, match=f"1 runs are not finished, such as {run.name}"):
        keep(committed, tmp_path / "kept")


@pytest.mark.parametrize("commit", ["0123456789ab+", "unknown"])
def test_results_of_no_commit_are_not_kept(committed, tmp_path, commit):
    with pytest.raises(ConfigError, match="no commit has"):
        keep(said_to_be_of(committed, commit), tmp_path / "kept")
