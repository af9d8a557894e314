"""The documentation: it builds strictly and loads nothing, says what is so, and its code runs."""

import ast
import inspect
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markdown.extensions.toc import slugify

import agents
from calfree_gym import ENV_IDS, WorldDistribution, nominal
from calfree_gym.perturbations import TYPES
from calfree_gym.robot.arms.movemaster import MOTORS, MOVEMASTER
from calfree_gym.tasks.reach import StereoArmEnv, observation_space
from experiments.__main__ import _parser
from experiments.config import loading
from experiments.config import suite as config
from experiments.reporting import results_file

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md"))]
LOADING = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}

BUILT = nominal()
DRAWN = {
    "camera position": lambda w: 100 * (w.camera_position - BUILT.camera_position),
    "focal length": lambda w: w.focal_length / BUILT.focal_length,
    "lens k1": lambda w: w.lens_k1,
    "link lengths": lambda w: 100 * (w.link_lengths / BUILT.link_lengths - 1),
    "joint zeros": lambda w: np.degrees(w.joint_zeros),
    "motor gain": lambda w: w.motor_gain,
    "motor curvature": lambda w: w.motor_curvature,
    "noise of image points": lambda w: w.point_noise,
    "strength of the lamp": lambda w: w.light_strength,
    "ambient light": lambda w: w.light_ambient,
    "exposure": lambda w: w.exposure,
    "blur of images": lambda w: w.blur,
    "noise of images": lambda w: w.image_noise,
}
"""Rows of the page about worlds, and what they are about, in the units of the page."""


class Page(HTMLParser):
    """A built page: text and tables (rows of cells) under each heading's anchor, and what a browser loads."""

    def __init__(self, path):
        super().__init__()
        self.text, self.tables, self.loads = {"": ""}, {"": []}, []
        self._anchor, self._cell = "", None
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        if tag in LOADING:
            self.loads.append(attributes.get(LOADING[tag]) or "")
        if re.fullmatch("h[1-6]", tag):
            self._anchor = attributes.get("id", "")
            self.text[self._anchor], self.tables[self._anchor] = "", []
        elif tag == "table":
            self.tables[self._anchor].append([])
        elif tag == "tr":
            self.tables[self._anchor][-1].append([])
        elif tag in ("td", "th"):
            self.tables[self._anchor][-1][-1].append("")
            self._cell = tag

    def handle_endtag(self, tag):
        if tag == self._cell:
            self._cell = None

    def handle_data(self, data):
        if self._cell:
            self.tables[self._anchor][-1][-1][-1] += data
        else:
            self.text[self._anchor] += data

    def table(self, anchor):
        """The first table under an anchor: the cells of each row by its first one, without the head."""
        rows = [[cell.strip() for cell in row] for row in self.tables[anchor][0]]
        return {row[0]: row[1:] for row in rows[1:]}


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
        loads = Page(path).loads
        assert loads
        assert not [address for address in loads if re.match("(https?:)?//", address)], path


def test_the_search_needs_no_server(site):
    """Opened from a file, a page gets the index as a script, and the search's code runs in a frame."""
    assert (site / "search" / "search_index.js").read_text().startswith("var __index = {")
    for path in [*site.glob("*.html"), *site.glob("tasks/*.html")]:
        assert any(address.endswith("iframe-worker.js") for address in Page(path).loads), path
    if not (browser := shutil.which("chromium")):
        pytest.skip("no chromium")
    words = [browser, "--headless=new", "--no-sandbox", "--virtual-time-budget=10000", "--dump-dom"]
    address = f"{(site / 'index.html').as_uri()}?q=perturbation"
    shown = subprocess.run([*words, address], capture_output=True, text=True, timeout=120).stdout
    assert re.search(r'md-search-result__meta">\d+ matching documents<', shown)


def test_the_page_of_a_task_is_its_docstring(site):
    page = Page(site / "tasks/reach.html")
    single, batched = "calfree_gym.tasks.reach.StereoArmEnv", "calfree_gym.tasks.reach.StereoArmVectorEnv"
    actions = page.table(f"{single}--action-space")
    assert [word for word, _ in actions.values()] == list(MOTORS)
    observations = page.table(f"{single}--observation-space")
    shapes = {key: str(box.shape) for key, box in observation_space("points", 128, (), MOVEMASTER).items()}
    assert {key: shape for key, (shape, _) in observations.items()} == shapes
    arguments = page.table(f"{single}--arguments")
    parameters = inspect.signature(StereoArmEnv).parameters
    assert arguments.keys() == parameters.keys()
    for name, (_, description, default) in arguments.items():
        assert description
        assert ast.literal_eval(default) == parameters[name].default
    for heading in ("description", "rewards", "starting-state", "episode-end", "version-history"):
        assert page.text[f"{single}--{heading}"].strip("¶ \n"), heading
    environments = Page(site / "environments.html")
    assert {"num_envs", "autoreset_mode", "threads"} <= environments.table(batched).keys()


def test_each_task_has_a_page_titled_by_its_id():
    titles = {page.read_text().splitlines()[0] for page in (ROOT / "docs/tasks").glob("*.md")}
    assert titles == {f"# {name}" for name in ENV_IDS if "Dense" not in name}


@pytest.mark.parametrize("page", PAGES)
def test_members_that_a_page_asks_for_are_shown(site, page):
    """A class shows none that it inherits, or that has no docstring, without a word."""
    text = (ROOT / page).read_text()
    for name, members in re.findall(
        r"^::: (\S+)\n    options:\n(?:      .*\n)*?      members: \[(.*)\]", text, re.M
    ):
        built = (site / page.removeprefix("docs/")).with_suffix(".html").read_text()
        lacking = [member for member in members.split(", ") if f'id="{name}.{member}"' not in built]
        assert not lacking, f"{name}: {lacking}"


@pytest.mark.parametrize("column", ["coarse", "wild"])
def test_worlds_page_tells_what_is_drawn(site, column):
    (head, *rows), *_ = Page(site / "worlds.html").tables["distributions"]
    documented = {row[0]: row[head.index(column)] for row in rows}
    worlds = [WorldDistribution(column).sample(seed) for seed in range(500)]
    for quantity, of in DRAWN.items():
        low, *high = re.findall(r"-?[\d.]+", documented[quantity]) or "0"
        if re.search("±|within", documented[quantity]):
            low, high = f"-{low}", [low]
        within(np.concatenate([of(world).ravel() for world in worlds]), " to ".join([low, *high]))


@pytest.mark.parametrize("kind", TYPES.values(), ids=TYPES)
def test_perturbations_page_tells_what_is_allowed_and_drawn(site, kind):
    documented = Page(site / "perturbations.html").table(kind.type)
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


def test_settings_page_names_every_agent(site):
    page = Page(site / "agent-settings.html")
    assert set(agents.names()) <= page.text.keys()


def test_configuration_page_names_every_key_and_column_and_its_example_is_valid(tmp_path):
    text = (ROOT / "docs/configuration.md").read_text()
    for model in (
        config.Suite,
        config.ScenarioConfig,
        config.EnvironmentConfig,
        config.EvaluationConfig,
        config.SweepConfig,
    ):
        for key in model.model_fields:
            assert f"`{key}`" in text, key
    for column in results_file.SCHEMA.names:
        assert f"`{column}`" in text, column
    (example,) = re.findall(r"^```yaml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    (tmp_path / "knocked.yaml").write_text(example)
    suite = loading.load(tmp_path / "knocked.yaml")
    assert [agent.label for agent in suite.agents] == ["unified_servo", "coarse_table"]


def test_configuration_page_names_every_command():
    text = (ROOT / "docs/configuration.md").read_text()
    (commands,) = (action for action in _parser()._actions if isinstance(action.choices, dict))
    for name in commands.choices:
        assert f"`python -m experiments {name}" in text, name


def test_configuration_page_tells_the_defaults():
    text = " ".join((ROOT / "docs/configuration.md").read_text().split())
    for key, field in config.EnvironmentConfig.model_fields.items():
        if not field.is_required():
            default = field.default
            told = (
                str(default).lower()
                if isinstance(default, bool)
                else {None: "null", (): "none"}.get(default, default)
            )
            assert re.search(rf"`{key}` \(`?{re.escape(str(told))}\b", text), key


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
    headings = re.findall(
        r"^#+ (.+?)$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE
    )
    return {slugify(re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading), "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_markers_of_tables_are_closed(page):
    markers = re.findall(r"^<!-- (table: \S.*?|end of table) -->$", (ROOT / page).read_text(), re.MULTILINE)
    assert markers[1::2] == ["end of table"] * (len(markers) // 2)
    names = markers[::2]
    assert len(names) == len(markers) / 2 == len(set(names))
    assert all(name.startswith("table: ") for name in names)
