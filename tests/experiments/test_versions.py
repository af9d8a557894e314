import ast

from experiments.versions import _WHAT_MAKES_A_RESULT, REPOSITORY


def imported_from(module, seen):
    """Files of `experiments` that a module imports, and what those import."""
    path = f"experiments/{module}.py"
    if path not in seen:
        seen.add(path)
        for node in ast.walk(ast.parse((REPOSITORY / path).read_text())):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("experiments."):
                imported_from(node.module.removeprefix("experiments."), seen)
    return seen


ONLY_STORES = {"experiments/curves.py", "experiments/errors.py", "experiments/folder.py"}


def test_the_code_that_makes_a_run_is_all_hashed():
    assert imported_from("worker", set()) - ONLY_STORES <= set(_WHAT_MAKES_A_RESULT)
