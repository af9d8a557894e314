"""Which claims stand: by the whole interval of each number that is a criterion of theirs."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import pandas as pd

from experiments.config.claims import Claim, Criterion
from experiments.config.suite import Suite
from experiments.reporting.claims.measures import Measured, measured
from experiments.reporting.finished_suite import ENOUGH_WORLDS


class Verdict(StrEnum):
    """What becomes of a claim, or of one of its criteria."""

    CONFIRMED = "confirmed"
    MIXED = "mixed"
    NOT_CONFIRMED = "not confirmed"
    UNTESTED = "untested"


@dataclass(frozen=True, slots=True)
class Judged:
    """A claim with what its criteria came to.

    Attributes:
        claim: The claim.
        found: Each criterion's number; None where there is none.
        verdicts: Of each criterion.
    """

    claim: Claim
    found: tuple[Measured | None, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def verdict(self) -> Verdict:
        """Confirmed where all criteria are, not confirmed where none of them can be, else mixed.

        A criterion without a number leaves the claim untested.
        """
        kinds = set(self.verdicts)
        if Verdict.UNTESTED in kinds:
            return Verdict.UNTESTED
        return kinds.pop() if len(kinds) == 1 else Verdict.MIXED


def verdict_of(criterion: Criterion, found: Measured | None) -> Verdict:
    """Confirmed where the whole interval meets the criterion, not confirmed where none does, else mixed.

    Untested by fewer than `ENOUGH_WORLDS`: numbers are given, and no verdict.
    """
    if found is None or found.worlds < ENOUGH_WORLDS:
        return Verdict.UNTESTED
    low, high = found.estimate.low, found.estimate.high
    if criterion.above is not None:
        passes, fails = low > criterion.above, high <= criterion.above
    else:
        assert criterion.below is not None
        passes, fails = high < criterion.below, low >= criterion.below
    return Verdict.CONFIRMED if passes else Verdict.NOT_CONFIRMED if fails else Verdict.MIXED


def judge(results: pd.DataFrame, suite: Suite) -> list[Judged]:
    """All claims of a suite, by its results."""
    judged = []
    for claim in suite.claims:
        found = tuple(measured(results, suite, criterion) for criterion in claim.criteria)
        verdicts = tuple(verdict_of(*each) for each in zip(claim.criteria, found, strict=True))
        judged.append(Judged(claim, found, verdicts))
    return judged


def in_words(judged: Sequence[Judged]) -> tuple[str, ...]:
    """Which claims stand, which fell, and how the paper's questions are answered: a sentence each."""
    return tuple(
        f"Of {len(of_kind)} {kind}s of the paper {_counted(of_kind)}."
        for kind in ("claim", "question")
        if (of_kind := [each for each in judged if each.claim.kind == kind])
    )


def _counted(judged: Sequence[Judged]) -> str:
    by_verdict = {
        verdict: [each.claim.name.replace("_", " ") for each in judged if each.verdict is verdict]
        for verdict in Verdict
    }
    return "; ".join(
        f"{len(names)} {'is' if len(names) == 1 else 'are'} {verdict} ({', '.join(names)})"
        for verdict, names in by_verdict.items()
        if names
    )
