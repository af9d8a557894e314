"""The documentation: it builds strictly and loads nothing, says what is so, and its code runs."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from markdown.extensions.toc import slugify

import agents
from calfree_gym.perturbations import TYPES
from experiments.__main__ import _parser
from experiments.config import loading
from experiments.config import suite as config
from experiments.reporting import results_file

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md"))]


LOADED = re.compile(r"""<(?:link\b[^>]*?\bhref|(?:script|img|iframe|source)\b[^>]*?\bsrc)=["']?([^"'>\s]*)""")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def test_pages_load_nothing_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 5
    for path in pages:
        loads = LOADED.findall(path.read_text())
        assert loads
        assert not [address for address in loads if re.match("(https?:)?//", address)], path


@pytest.mark.parametrize("kind", TYPES.values(), ids=TYPES)
def test_perturbations_page_tells_what_is_allowed_and_drawn(kind, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    section = importlib.import_module("hooks")._section(kind).replace("`", "")
    rows = [row.split(" | ") for row in re.findall(r"^\| (.*) \|$", section, re.M)]
    documented = {name: cells for name, *cells in rows[2:]}
    rng = np.random.default_rng(0)
    drawn = [kind().drawn(rng).to_dict() for _ in range(500)]
    drawn_slowly = [kind().drawn(rng, slowly=True).to_dict() for _ in range(500)]
    assert documented.keys() == drawn[0].keys() - {"type"}
    for name, (_, allowed, at_once, slowly) in documented.items():
        values = {draw[name] for draw in drawn}
        if at_once == "any of them":
            assert values == set(allowed.split(", "))
            continue
        within(values, at_once)
        within({draw[name] for draw in drawn_slowly}, at_once if slowly == "the same" else slowly)
        if allowed == "any number":
            kind(**{name: -1e6})
            continue
        least, most = map(float, re.fullmatch(r"(?:whole )?numbers (\S+) to (\S+)", allowed).groups())
        whole = allowed.startswith("whole")
        for end, beyond in ((least, least - 1), (most, most + 1)):
            kind(**{name: int(end) if whole else end})
            with pytest.raises(ValueError, match=name):
                kind(**{name: int(beyond) if whole else beyond})


def within(values, ends):
    """Checks that values fill the range that a page tells, and do not leave it."""
    low, high = (float(end) for end in (ends.split(" to ") * 2)[:2])
    margin = 0.02 * (high - low)
    assert low - margin <= min(values)
    assert max(values) <= high + margin
    assert max(values) - min(values) >= 0.85 * (high - low)


def test_settings_page_names_every_agent():
    assert set(agents.names()) <= anchors((ROOT / "docs/agent-settings.md").read_text())


def test_configuration_page_names_all_that_there_is_and_its_example_is_valid(tmp_path):
    text = (ROOT / "docs/configuration.md").read_text()
    models = (config.Suite, config.ScenarioConfig, config.EnvironmentConfig, config.EvaluationConfig)
    (commands,) = (action for action in _parser()._actions if isinstance(action.choices, dict))
    named = {key for model in (*models, config.SweepConfig) for key in model.model_fields}
    named |= set(results_file.SCHEMA.names)
    assert [each for each in named if f"`{each}`" not in text] == []
    assert [each for each in commands.choices if f"`python -m experiments {each}" not in text] == []
    (example,) = re.findall(r"^```yaml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    (tmp_path / "knocked.yaml").write_text(example)
    suite = loading.load(tmp_path / "knocked.yaml")
    assert [agent.label for agent in suite.agents] == ["unified_servo", "coarse_table"]


def test_what_the_map_of_the_paper_names_exists():
    page = (ROOT / "docs/paper.md").read_text()
    for file, name in re.findall(r"`([\w/]+\.(?:py|yaml|xml))(?:::([\w.]+))?`", page):
        text = (ROOT / file).read_text()
        for part in filter(None, name.split(".")):
            assert re.search(rf"\b{part}\b", text), f"{file}::{name}"


@pytest.mark.parametrize("page", [*PAGES, "CONTRIBUTING.md", "RELEASING.md", "SECURITY.md"])
def test_links_of_a_page_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", (ROOT / page).read_text()):
        if not re.match("https?:", link):
            path, _, anchor = link.partition("#")
            target = (ROOT / page).parent / path if path else ROOT / page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target.read_text()), link


def anchors(text):
    """The anchors of a page's headings, as mkdocs and GitHub make them."""
    headings = re.findall("^#+ (.+?)$", re.sub("^```.*?^```", "", text, flags=re.S | re.M), re.M)
    return {slugify(re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading), "-") for heading in headings}
