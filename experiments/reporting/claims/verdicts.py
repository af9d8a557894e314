"""Which claims stand: by the whole interval of each number that they are tested by."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import pandas as pd

from experiments.config.claims import Claim, Criterion
from experiments.config.suite import Suite
from experiments.reporting.claims.measures import Measured, measured


class Verdict(StrEnum):
    """What becomes of a claim, or of one of its tests."""

    CONFIRMED = "confirmed"
    MIXED = "mixed"
    NOT_CONFIRMED = "not confirmed"
    UNTESTED = "untested"


@dataclass(frozen=True, slots=True)
class Judged:
    """A claim with what its tests came to.

    Attributes:
        claim: The claim.
        found: Each test's number; None where there is none.
        verdicts: Of each criterion.
    """

    claim: Claim
    found: tuple[Measured | None, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def verdict(self) -> Verdict:
        """Confirmed where all tests pass, not confirmed where all fail, else mixed.

        A test that could not be made leaves the claim untested.
        """
        kinds = set(self.verdicts)
        if Verdict.UNTESTED in kinds:
            return Verdict.UNTESTED
        return kinds.pop() if len(kinds) == 1 else Verdict.MIXED


def verdict_of(criterion: Criterion, found: Measured | None) -> Verdict:
    """Confirmed where the whole interval passes, not confirmed where it wholly fails, else mixed."""
    if found is None:
        return Verdict.UNTESTED
    low, high = found.estimate.low, found.estimate.high
    if criterion.at_least is not None:
        passes, fails = low >= criterion.at_least, high < criterion.at_least
    else:
        assert criterion.at_most is not None
        passes, fails = high <= criterion.at_most, low > criterion.at_most
    return Verdict.CONFIRMED if passes else Verdict.NOT_CONFIRMED if fails else Verdict.MIXED


def judge(results: pd.DataFrame, suite: Suite) -> list[Judged]:
    """All claims of a suite, by its results."""
    judged = []
    for claim in suite.claims:
        found = tuple(measured(results, suite, criterion) for criterion in claim.criteria)
        verdicts = tuple(verdict_of(*each) for each in zip(claim.criteria, found, strict=True))
        judged.append(Judged(claim, found, verdicts))
    return judged


def in_words(judged: Sequence[Judged]) -> str:
    """Which claims stand and which fell, in one or two sentences."""
    by_verdict = {
        verdict: [each.claim.name.replace("_", " ") for each in judged if each.verdict is verdict]
        for verdict in Verdict
    }
    parts = [
        f"{len(names)} {'is' if len(names) == 1 else 'are'} {verdict} ({', '.join(names)})"
        for verdict, names in by_verdict.items()
        if names
    ]
    return f"Of {len(judged)} claims of the paper {'; '.join(parts)}."
