"""What a release is made of says one thing everywhere: versions, and the names of the contract."""

import pkgutil
import re
import tomllib
from pathlib import Path

import yaml

import calfree_gym

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
EXTRAS = ("agents", "experiments", "perturb", "vision", "cluster")
ENVIRONMENTS_NEED = {"mujoco": "3.17"}
"""More than `Perturb` does, see `calfree_gym.robot.simulation`."""


def test_the_citation_is_of_this_version():
    assert CITATION["version"] == calfree_gym.__version__


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


def test_names_of_the_contract_are_there():
    page = (ROOT / "docs/contract.md").read_text()
    names = re.findall(r"`((?:calfree_gym|agents|experiments)(?:\.\w+)*)(?:\(\))?`", page)
    assert len(names) > 10
    for name in names:
        pkgutil.resolve_name(name)
