"""The claims' part of the report."""

from collections.abc import Sequence

import pandas as pd

from experiments.config.claims import Criterion, Number, TrialsOf
from experiments.reporting.claims.measures import (
    EXPECTED_PX,
    FEW_MOTIONS,
    FIRST_MOTION_PX,
    NEAR_PX,
    Measured,
    is_share,
)
from experiments.reporting.claims.verdicts import Judged, in_words
from experiments.reporting.finished_suite import SUCCESS_IN_WORDS
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent

_MEASURES = {
    "success": "success",
    "near": f"true error within {NEAR_PX} px",
    "rendezvous": "rendezvous",
    "motions": "motions per reach",
    "most_motions": "motions per reach of 95 % of trials",
    "worst_world": "motions per reach in the worst world",
    "seconds": "robot seconds a reach",
    "first_motion": f"first motion within {FIRST_MOTION_PX} px",
    "as_expected": f"where it tells what it expects, it is right about its first motion's {EXPECTED_PX} px",
    "kept": f"trials of at most {FEW_MOTIONS} motions that stay so",
}
_HOW_TO_READ = (
    "Thresholds stand in the configuration. Each number has its 95 % interval over worlds: shares are "
    "means over worlds, motions and seconds medians over worlds of each world's mean. Where two are "
    "compared, it is in the same worlds: the mean of the differences of shares, the median of those of "
    "motions; a change is that of the mean over worlds, as a share of what it was, with a t interval. "
    "Confirmed: the whole interval meets the criterion. Not confirmed: none of it does. Mixed: neither, "
    "or the criteria of a claim differ. Untested: a run has not finished, no world has such trials, or "
    "there are fewer than 20 worlds. Questions are what the paper leaves open; judged is the answer that "
    f"it suggests. {SUCCESS_IN_WORDS} Rendezvous: the last observation was. Motions per reach: without a "
    "rendezvous the cap. A world whose lifetime was over before such trials is left out."
)


def claims_section(judged: Sequence[Judged]) -> Section:
    """Each claim, its verdict, and the numbers behind it."""
    rows, summary = [], []
    for each in judged:
        claim = each.claim
        judgements = zip(claim.criteria, each.found, each.verdicts, strict=True)
        for i, (criterion, found, verdict) in enumerate(judgements):
            name = "" if i else claim.name.replace("_", " ")
            must_be = threshold(criterion)
            rows.append([name, described(criterion), number_of(criterion, found), must_be, str(verdict)])
            where = criterion.of.scenario, "claims", criterion.of.agent, f"{claim.name}.{i}"
            measure, worlds = f"{criterion.measure}: {verdict}", found.worlds if found else 0
            summary.append(summary_row(*where, measure, found.estimate if found else None, worlds))
    columns = ["claim or question", "criterion", "measured", "must be", "verdict"]
    remarks = " ".join(f"{each.claim.words} {each.claim.remark}" for each in judged if each.claim.remark)
    return Section(
        title="The paper's claims",
        text=" ".join(in_words(judged)),
        tables=(
            verdict_table(judged),
            Table("claims", "What was measured", pd.DataFrame(rows, columns=columns)),
        ),
        note=f"{_HOW_TO_READ} {remarks}".strip(),
        summary=summary,
    )


def verdict_table(judged: Sequence[Judged]) -> Table:
    """Each claim and its verdict."""
    rows = [
        [
            each.claim.name.replace("_", " "),
            each.claim.words,
            each.claim.kind,
            each.claim.section,
            str(each.verdict),
        ]
        for each in judged
    ]
    columns = ["claim or question", "in words", "kind", "section", "verdict"]
    return Table("verdicts", "Verdicts", pd.DataFrame(rows, columns=columns))


def described(criterion: Number) -> str:
    """What a criterion measures, in words."""
    look = f", {criterion.look:g} s a look" if criterion.look else ""
    words = f"{_in_words(criterion.of)}: {_MEASURES[criterion.measure]}{look}"
    if criterion.than is None:
        return words
    of, than = criterion.of, criterion.than
    other = _when(than) if (of.agent, of.scenario) == (than.agent, than.scenario) else _in_words(than)
    if criterion.measure == "kept":
        return f"{words} since {other}"
    return f"{words}, {'change' if criterion.relative else 'difference'} from {other}"


def number_of(criterion: Number, found: Measured | None) -> str:
    """A criterion's number with its interval, as its measure is written."""
    if found is None:
        return "unfinished, or no such trials"
    shares = criterion.relative or is_share(criterion)
    return percent(found.estimate) if shares else number(found.estimate)


def threshold(criterion: Criterion) -> str:
    """What the number must be for the claim to hold."""
    bound = criterion.above if criterion.above is not None else criterion.below
    sign = "above" if criterion.above is not None else "below"
    shares = criterion.relative or is_share(criterion)
    return f"{sign} {bound:.0%}".replace("%", " %") if shares else f"{sign} {bound:g}"


def _in_words(trials: TrialsOf) -> str:
    return f"{trials.agent}, {trials.scenario}, {_when(trials)}"


def _when(trials: TrialsOf) -> str:
    if trials.trials is not None:
        first, last = trials.trials
        return f"own trial {first}" if first == last else f"own trials {first}–{last}"
    if trials.motions is not None:
        return f"after {trials.motions:,} motions"
    return f"at {trials.value:g}"
