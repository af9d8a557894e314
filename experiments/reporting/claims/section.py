"""The claims' part of the report."""

from collections.abc import Sequence

import pandas as pd

from experiments.config.claims import Criterion, Moment
from experiments.reporting.claims.measures import EXPECTED_PX, FEW_MOTIONS, FIRST_MOTION_PX, Measured
from experiments.reporting.claims.verdicts import Judged, in_words
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, number, percent

_MEASURES = {
    "success": "success",
    "rendezvous": "rendezvous",
    "motions": "motions a reach",
    "seconds": "robot seconds a reach",
    "first_motion": f"first motion within {FIRST_MOTION_PX} px",
    "as_expected": f"it tells before whether its first motion comes within {EXPECTED_PX} px",
    "kept": f"trials of at most {FEW_MOTIONS} motions that stay so",
}
_HOW_TO_READ = (
    "Claims and thresholds stand in the configuration, and were committed before the results. Each "
    "number has its 95 % interval over worlds: shares are means over worlds, motions and seconds "
    "medians over worlds of each world's mean; where two are compared, it is the mean of the paired "
    "differences in the same worlds. Confirmed: the whole interval passes. Not confirmed: it wholly "
    "fails. Mixed: neither, or the tests of a claim differ. Success: the true error at the end is "
    "within the tolerance. Rendezvous: the last observation was. Motions a reach: without a rendezvous "
    "the cap. A run that failed counts as worst; a world whose lifetime was over before is left out."
)


def claims_section(judged: Sequence[Judged]) -> Section:
    """Each claim, its verdict, and the numbers behind it."""
    rows, summary = [], []
    for each in judged:
        claim = each.claim
        head = [claim.words, claim.section, str(each.verdict)]
        judgements = zip(claim.criteria, each.found, each.verdicts, strict=True)
        for i, (criterion, found, verdict) in enumerate(judgements):
            worlds = found.worlds if found else 0
            cells = [described(criterion), number_of(criterion, found), threshold(criterion), str(verdict)]
            rows.append([*head, *cells, worlds])
            head = ["", "", ""]
            where = criterion.of.scenario, "claims", criterion.of.agent, f"{claim.name}.{i}"
            measure = f"{criterion.measure}: {verdict}"
            summary.append(summary_row(*where, measure, found.estimate if found else None, worlds))
    columns = ["claim", "section", "verdict", "tested by", "measured", "must be", "so", "worlds"]
    remarks = " ".join(f"{each.claim.words} {each.claim.remark}" for each in judged if each.claim.remark)
    return Section(
        title="The paper's claims",
        said=(in_words(judged),),
        table=Table("claims", "Claims", pd.DataFrame(rows, columns=columns)),
        note=f"{_HOW_TO_READ} {remarks}".strip(),
        summary=summary,
    )


def described(criterion: Criterion) -> str:
    """What a test measures, in words."""
    measure = _MEASURES.get(
        criterion.measure, f"robot seconds a reach, {criterion.look:g} s a look" if criterion.look else ""
    )
    words = f"{_trials(criterion.of)}: {measure}"
    if criterion.than is None:
        return words
    if criterion.measure == "kept":
        return f"{words} since {_when(criterion.than)}"
    same = criterion.than.agent == criterion.of.agent and criterion.than.scenario == criterion.of.scenario
    other = _when(criterion.than) if same else _trials(criterion.than)
    return f"{words}, {'change' if criterion.relative else 'difference'} from {other}"


def number_of(criterion: Criterion, found: Measured | None) -> str:
    """A test's number with its interval, as its measure is written."""
    if found is None:
        return "no such trials"
    shares = criterion.relative or criterion.measure not in ("motions", "seconds")
    return percent(found.estimate) if shares else number(found.estimate)


def threshold(criterion: Criterion) -> str:
    """What the number must be for the claim to hold."""
    shares = criterion.relative or criterion.measure not in ("motions", "seconds")
    bound = criterion.at_least if criterion.at_least is not None else criterion.at_most
    sign = "≥" if criterion.at_least is not None else "≤"
    return f"{sign} {bound:.0%}".replace("%", " %") if shares else f"{sign} {bound:g}"


def _trials(moment: Moment) -> str:
    return f"{moment.agent}, {moment.scenario}, {_when(moment)}"


def _when(moment: Moment) -> str:
    if moment.trials is not None:
        first, last = moment.trials
        return f"own trial {first}" if first == last else f"own trials {first}–{last}"
    if moment.motions is not None:
        return f"after {moment.motions:,} motions"
    return f"at {moment.value:g}"
