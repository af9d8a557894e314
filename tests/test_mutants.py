"""The list of mutants is of the code that stands beside it; `make mutants` tries them."""

import re

import pytest

from tests.mutants.mutant import ROOT, mutants

MUTANTS = mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_it_applies_and_names_tests_that_exist(mutant):
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    edited = mutant.applied(text)
    assert edited != text
    compile(edited, mutant.file, "exec")
    assert mutant.tests
    assert mutant.why
    assert sum(each.name == mutant.name for each in MUTANTS) == 1
    for test in mutant.tests:
        file, *names = test.split("::")
        path = ROOT / file
        assert path.is_file() or (path.is_dir() and not names), f"there is no {file}"
        for name in names:
            function = name.partition("[")[0]
            assert re.search(rf"^def {function}\(", path.read_text(encoding="utf-8"), re.M), f"no {test}"
