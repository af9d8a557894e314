"""What the project asks of itself in a suite, and what was measured."""

import pandas as pd

from experiments.config.claims import Requirement
from experiments.config.suite import Suite
from experiments.reporting.claims.measures import is_share, measured
from experiments.reporting.claims.section import described, number_of
from experiments.reporting.pages import Section
from experiments.reporting.tables import Table

_HOW_TO_READ = (
    "Shares are means over worlds; motions are medians over worlds of each world's mean or, where it says "
    "so, those that 95 % of trials need no more of, or of the worst world. Met: the number itself is as "
    "required, wherever its 95 % interval over worlds ends."
)


def required_section(results: pd.DataFrame, suite: Suite) -> Section:
    """Each number that is required, and whether it was met."""
    rows = []
    for requirement in suite.required:
        found = measured(results, suite, requirement)
        met = "unfinished" if found is None else "yes" if _is_met(requirement, found.estimate.value) else "NO"
        rows.append([described(requirement), number_of(requirement, found), _bound(requirement), met])
    table = Table(
        "required", "What is required", pd.DataFrame(rows, columns=["of", "measured", "required", "met"])
    )
    return Section(title="What is required", tables=(table,), note=_HOW_TO_READ)


def _is_met(requirement: Requirement, value: float) -> bool:
    if requirement.at_least is not None:
        return value >= requirement.at_least
    assert requirement.at_most is not None
    return value <= requirement.at_most


def _bound(requirement: Requirement) -> str:
    least = requirement.at_least is not None
    bound = requirement.at_least if requirement.at_least is not None else requirement.at_most
    assert bound is not None
    written = f"{100 * bound:g} %" if requirement.relative or is_share(requirement) else f"{bound:g}"
    return f"at {'least' if least else 'most'} {written}"
