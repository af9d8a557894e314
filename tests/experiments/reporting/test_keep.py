"""What is kept of a finished suite, and of a benchmark."""

import io
import json
import shutil

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from PIL import Image, ImageColor

from experiments.__main__ import main
from experiments.errors import ConfigError
from experiments.reporting import keep as module
from experiments.reporting import kept_tables
from experiments.reporting.figures import colour
from experiments.reporting.keep import fewer_colours, keep, keep_benchmark
from experiments.reporting.kept_tables import KEPT, tables_named
from experiments.reporting.results_file import gather
from experiments.reporting.tables import Table

COMMIT = "0123456789ab"
NAMES = [
    *("oracle", "paper_servo", "grid_table", "memory"),
    *("self_supervised", "sac", "ppo", "cooperstock_milios"),
]
TABLES = ("tables.json", "timings.csv")


@pytest.fixture
def committed(finished_once, tmp_path, monkeypatch):
    """Finished results that are said to be made by a commit, beside sources that are said to be of one."""
    monkeypatch.setattr(module, "commit", lambda: "ba9876543210")
    return said_to_be(shutil.copytree(finished_once, tmp_path / "out"), commit=COMMIT)


def said_to_be(out, **what):
    about = json.loads((out / "suite.json").read_text())
    (out / "suite.json").write_text(json.dumps({**about, **what}))
    gather(out)
    return out


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_lines_of_a_kept_figure_keep_their_colours():
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.7))
    motions = np.linspace(0, 1, 9)
    for index, name in enumerate(NAMES):
        for panel, curve in zip(axes, (motions**index, 1 - motions**index, index + motions), strict=True):
            line = {"color": colour(name, name), "linewidth": 2}
            panel.plot(motions, curve, **line)
            panel.fill_between(motions, curve - 0.2, curve + 0.1, color=line["color"], alpha=0.15)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=160)
    plt.close(figure)
    image = Image.open(drawn).convert("RGB")
    before, after = (np.asarray(each.convert("RGB"), int) for each in (image, fewer_colours(image)))
    for name in NAMES:
        wanted = np.array(ImageColor.getrgb(colour(name, name)))
        kept = after[(before == wanted).all(-1)]
        assert len(kept) > 500
        assert np.abs(np.median(kept, 0) - wanted).max() <= 6


@pytest.mark.slow
def test_numbers_report_and_small_figures_are_kept(committed, tmp_path):
    kept = keep(committed, tmp_path / "kept")
    assert kept == tmp_path / "kept" / "tiny"
    figures = ["figures/aimed-held-out.png"]
    assert files(kept) == [*figures, "report.md", "results.parquet", "summary.csv", *TABLES]
    assert main(["report", str(committed)]) == 0
    for name in ("results.parquet", "summary.csv", "report.md", *TABLES):
        assert (kept / name).read_bytes() == (committed / name).read_bytes()
    for name in figures:
        assert (kept / name).stat().st_size < 0.6 * (committed / name).stat().st_size
        with Image.open(kept / name) as small, Image.open(committed / name) as large:
            assert small.size == large.size
    assert COMMIT in tables_named("tiny/aimed", tmp_path / "kept")


def test_what_was_kept_before_is_replaced_and_a_film_that_lies_beside_is_kept(committed, tmp_path):
    for name in ("tiny", ".tiny.partial"):
        stale = tmp_path / "kept" / name
        stale.mkdir(parents=True)
        for file in ("report.md", "stale.csv", "summary.csv"):
            (stale / file).write_text("stale")
    (committed / "figures" / "of-an-earlier-report.png").write_bytes(b"")
    Image.new("RGB", (4, 4)).save(committed / "film.gif")
    kept = keep(committed, tmp_path / "kept")
    assert not [name for name in files(kept) if "stale" in name or "earlier" in name]
    assert "![An agent at work](film.gif)" in (kept / "report.md").read_text()
    assert (kept / "film.gif").exists()
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["tiny"]


def test_the_report_of_what_is_kept_can_be_made_again_by_later_code(committed, tmp_path, monkeypatch):
    kept = keep(committed, tmp_path / "kept")
    before = {name: (kept / name).read_bytes() for name in files(kept)}
    (kept / "report.md").write_text("of earlier code")
    monkeypatch.setattr(module, "versions", lambda: {"code": "of later code"})
    assert keep(kept, tmp_path / "kept") == kept
    assert {name: (kept / name).read_bytes() for name in files(kept)} == before
    with pytest.raises(ConfigError, match="was made by other code"):
        keep(committed, tmp_path / "kept")


def test_what_was_kept_before_stays_where_the_new_cannot_be_made(committed, tmp_path, monkeypatch):
    def full(finished):
        raise OSError("the disk is full")

    kept = tmp_path / "kept" / "tiny" / "report.md"
    kept.parent.mkdir(parents=True)
    kept.write_text("of before")
    kept.with_name("summary.csv").write_text("")
    monkeypatch.setattr(module, "write_report", full)
    with pytest.raises(OSError, match="full"):
        keep(committed, tmp_path / "kept")
    assert kept.read_text() == "of before"


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"commit": f"{COMMIT}+"}, "out was made by files that no commit has"),
        ({"commit": f"{COMMIT}, {COMMIT}+"}, "out was made by files that no commit has"),
        ({"commit": "unknown"}, "out was made by files that no commit has"),
        ({"command": "python run a.yaml --set worlds=2"}, r"changed by --set \(python .* worlds=2\)"),
    ],
)
def test_what_cannot_be_made_again_is_not_kept(committed, tmp_path, spoil, said):
    with pytest.raises(ConfigError, match=said):
        keep(said_to_be(committed, **spoil), tmp_path / "kept")


def test_what_is_not_whole_or_of_other_code_is_not_kept(committed, tmp_path, monkeypatch):
    def refused(said):
        with pytest.raises(ConfigError, match=said):
            keep(committed, tmp_path / "kept")

    with monkeypatch.context() as of_no_commit:
        of_no_commit.setattr(module, "commit", lambda: f"{COMMIT}+")
        refused("this report would be made by files that no commit has")
    with monkeypatch.context() as later:
        later.setattr(module, "versions", lambda: {"code": "later"})
        refused(r"was made by other code \(\w{12}, here it is later\)")
    tables = tmp_path / "kept" / "tiny" / "choices.json"
    tables.parent.mkdir(parents=True)
    tables.write_text("{}")
    refused(r"holds kept results that are no suite's \(summary\.csv is missing")
    assert tables.read_text() == "{}"
    run = next((committed / "runs").iterdir())
    shutil.rmtree(run)
    (committed / "results.parquet").unlink()
    gather(committed)
    refused(f"1 runs are not finished, such as {run.name}")


def test_kept_rows_are_small_enough_for_a_repository():
    assert sum(path.stat().st_size for path in KEPT.glob("*/results.parquet")) <= 6_000_000


def test_the_claims_of_a_kept_suite_are_tables(committed, tmp_path):
    trials = {"agent": "unified_servo", "scenario": "aimed", "motions": 0}
    criterion = {"measure": "rendezvous", "of": trials, "above": 0.5, "null_agent": "random"}
    claim = {"name": "it_works", "section": "1", "words": "It works.", "criteria": [criterion]}
    suite = json.loads((committed / "suite.json").read_text())["suite"]
    keep(said_to_be(committed, suite={**suite, "claims": [claim]}), tmp_path / "kept")
    verdicts = tables_named("tiny/verdicts", tmp_path / "kept")
    assert "| it works | It works. | claim | 1 | untested |" in verdicts
    assert "above 50 %" in tables_named("tiny/claims", tmp_path / "kept")
    assert "unified servo" in tables_named("tiny/aimed", tmp_path / "kept")


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


def test_the_figure_of_a_study_is_kept_with_it(measured, tmp_path):
    Image.new("RGB", (3, 2), "red").save(measured.with_suffix(".png"))
    folder = keep_benchmark(measured, tmp_path / "kept")
    with Image.open(folder / "mine.png") as kept:
        assert kept.convert("RGB").getpixel((1, 1)) == (255, 0, 0)
    assert "\n\n![mine](mine.png)\n\n## Rolled" in (folder / "report.md").read_text()


def test_one_that_cannot_be_shown_replaces_none(measured, tmp_path):
    folder = keep_benchmark(measured, tmp_path / "kept")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    found = json.loads(measured.read_text())
    found["tables"][0]["formats"]["success"] = "q"
    measured.write_text(json.dumps(found))
    with pytest.raises(ConfigError, match="Unknown format code 'q'"):
        keep_benchmark(measured, tmp_path / "kept")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_what_is_no_benchmark_is_refused(measured, tmp_path):
    kept = tmp_path / "kept"
    with pytest.raises(ConfigError, match=r"other\.json: there is no such file"):
        keep_benchmark(tmp_path / "other.json", kept)
    (kept / "mine").mkdir(parents=True)
    (kept / "mine" / "summary.csv").write_text("")
    with pytest.raises(ConfigError, match="holds the results of a suite"):
        keep_benchmark(measured, kept)
    measured.write_text(measured.read_text().replace('"abc"', '"abc+"'))
    with pytest.raises(ConfigError, match=r"was made by files that no commit has \(abc\+\)"):
        keep_benchmark(measured, kept)
    measured.write_text("{}")
    with pytest.raises(ConfigError, match="damaged or no kept result"):
        keep_benchmark(measured, kept)
