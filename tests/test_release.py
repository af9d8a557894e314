"""What a release is made of says one thing everywhere: versions, packages, workflows, cards."""

import json
import pkgutil
import re
import tomllib
from pathlib import Path

import yaml

import calfree_gym

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
WORKFLOWS = {path.name: path.read_text() for path in (ROOT / ".github/workflows").glob("*.yml")}
EXTRAS = ("agents", "experiments", "perturb", "vision", "cluster")
ENVIRONMENTS_NEED = {"mujoco": "3.17"}
"""More than `Perturb` does, see `calfree_gym.robot.simulation`."""


def test_the_citation_is_of_this_version():
    assert CITATION["version"] == calfree_gym.__version__


def test_zenodo_is_told_what_the_citation_says():
    told = json.loads((ROOT / ".zenodo.json").read_text())
    assert (told["title"], told["keywords"]) == (CITATION["title"], CITATION["keywords"])
    assert [each["name"] for each in told["creators"]] == [each["name"] for each in CITATION["authors"]]
    assert told["license"] == CITATION["license"] == PROJECT["license"]


def test_the_lowest_versions_are_those_that_the_project_allows():
    text = (ROOT / "constraints-lowest.txt").read_text()
    lowest = dict(re.findall(r"^([\w-]+)==([\d.]+)$", text, re.M))
    required = PROJECT["dependencies"] + [
        each for extra in EXTRAS for each in PROJECT["optional-dependencies"][extra]
    ]
    bounds = dict(re.match(r"([\w-]+)>=([\d.]+)", each).groups() for each in required) | ENVIRONMENTS_NEED
    assert lowest.keys() == bounds.keys()
    for name, bound in bounds.items():
        assert f"{lowest[name]}.".startswith(f"{bound}."), name


def test_workflows_have_no_secret_and_no_host_and_run_what_there_is():
    assert WORKFLOWS.keys() == {"tests.yml", "docs.yml", "release.yml"}
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M))
    for text in WORKFLOWS.values():
        assert "secrets" not in text
        assert "://" not in text
        assert yaml.safe_load(text)["permissions"] == {"contents": "read"}
        used = re.findall(r"uses: (\w\S*)", text)
        assert all(re.search(r"^actions/.*@v\d+$|@[0-9a-f]{40}$", each) for each in used)
        assert text.count("persist-credentials: false") == sum("actions/checkout@" in each for each in used)
        assert set(re.findall(r"\bmake ([\w-]+)", text)) <= targets
        assert all((ROOT / each).exists() for each in re.findall(r"tests/\w+\.py|constraints-\w+\.txt", text))


def test_only_what_is_on_main_is_released():
    """And only the last job may publish: it runs no code of the repository."""
    jobs = yaml.safe_load(WORKFLOWS["release.yml"])["jobs"]
    asked = [step.get("run", "") for step in jobs["build"]["steps"]]
    assert 'git merge-base --is-ancestor "$GITHUB_SHA" origin/main' in asked
    assert jobs["build"]["steps"][0]["with"]["fetch-depth"] == 0
    assert "build" in jobs["publish"]["needs"]
    assert {name: job.get("permissions") for name, job in jobs.items()} == {
        "tests": None,
        "build": None,
        "publish": {"id-token": "write"},
    }


def test_the_wheel_is_tried_with_every_python_that_is_named():
    named = {each.rpartition(" ")[2] for each in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", each)}
    jobs = yaml.safe_load(WORKFLOWS["tests.yml"])["jobs"]
    assert {each["python"] for each in jobs["wheel"]["strategy"]["matrix"]["include"]} == named


def test_whatever_ships_trained_or_tuned_has_a_card():
    page = (ROOT / "docs/model-cards.md").read_text()
    shipped = {path.stem for path in (ROOT / "configs/agents").glob("*.yaml")}
    of_weights = {"weights": "recurrent_servo", "prior": "simulation_prior"}
    files = [*(ROOT / "agents").rglob("*.safetensors"), *(ROOT / "agents").rglob("*.npz")]
    shipped |= {of_weights.get(path.stem, path.stem) for path in files}
    (tuned,) = re.findall(r"^## Tuned.*", page, re.M | re.S)
    rows = [cell for line in tuned.splitlines() if line.startswith("| `") for cell in line.split("|")[1:2]]
    carded = {name for cell in rows for name in re.findall(r"`(\w+)`", cell)}
    assert carded | set(re.findall(r"^## `(\w+)`", page, re.M)) == shipped


def test_names_of_the_contract_are_there():
    page = (ROOT / "docs/contract.md").read_text()
    names = re.findall(r"`((?:calfree_gym|agents|experiments)(?:\.\w+)*)(?:\(\))?`", page)
    assert len(names) > 10
    for name in names:
        pkgutil.resolve_name(name)
