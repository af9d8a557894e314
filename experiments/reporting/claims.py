"""Claims of the paper: what was measured for each criterion, the verdicts, and their section of the report.

A claim stands or falls by the whole interval of each number that is a criterion of it, and by whether an
agent without what is claimed, its null agent, fails by the same number.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pandas as pd

from experiments.config.claims import EXTREMES, Claim, Criterion, Number, Requirement, TrialsOf
from experiments.config.suite import ScenarioConfig, Suite, SweepConfig
from experiments.reporting.by_trial import seconds_per_reach
from experiments.reporting.finished_suite import (
    FAR_MM,
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    SUCCESS_IN_WORDS,
    with_cost,
)
from experiments.reporting.held_out import with_clocks
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.tables import Table, counted, number, percent, written
from experiments.statistics import (
    ENOUGH_WORLDS,
    EQUAL,
    Estimate,
    mean_share,
    median_world,
    paired_motions,
    paired_shares,
    relative_change,
)

ENOUGH_TO_FAIL = 8
"""In so many worlds an interval wholly on the wrong side tells enough. Choice: what none of eight shows, a
third of all worlds does at most (Clopper & Pearson, one-sided 95 %)."""
FIRST_MOTION_PX, EXPECTED_PX = 4, 16
"""Columns of `motions_to_...`: where a first motion counts as a reach, and what an expectation is about."""
NEAR_PX = 16
"""The true error of a trial that ended near."""
FEW_MOTIONS = 2
"""Held-out trials of so many motions are those that are asked to be kept. Choice: a remembered place and one
correction."""
_MEASURES = {
    "success": "success",
    "near": f"true error within {NEAR_PX} px",
    "far": f"ends more than {FAR_MM} mm off",
    "rendezvous": "rendezvous",
    "quickly": "rendezvous",
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
    "In round brackets the margin: by how many half-intervals, of the half that points to the threshold, "
    "the number meets it; from -1 down none of the interval does. A null agent is one without what is "
    "claimed, by the same measure in the same cells. Confirmed: the whole interval meets the criterion, and "
    "none of the null agent's does. Vacuous: the null agent's whole interval meets it, too. Not confirmed: "
    f"none of the interval does, in {ENOUGH_TO_FAIL} worlds or more. Mixed: none of these, or criteria "
    "differ. Untested: a run has not finished, no world has such trials, or fewer than "
    f"{ENOUGH_WORLDS} worlds tell neither. Questions are what the paper leaves open; judged is the answer "
    f"that it suggests. {SUCCESS_IN_WORDS} Rendezvous: the last observation was. Motions per reach: without "
    "a rendezvous the cap. A world whose lifetime was over before such trials is left out."
)


_HOW_REQUIRED = (
    "Shares are means over worlds; motions are medians over worlds of each world's mean or, where it says "
    "so, those that 95 % of trials need no more of, or of the worst world. Met: the number itself is as "
    "required, wherever its 95 % interval over worlds ends."
)


@dataclass(frozen=True, slots=True)
class Measured:
    """The number of a criterion, with its 95 % interval over so many worlds."""

    estimate: Estimate
    worlds: int


def measured(results: pd.DataFrame, suite: Suite, criterion: Number) -> Measured | None:
    """What a criterion's number is; None where a run that it is about has not finished.

    It is the mean over worlds of shares and of their differences, and the median over worlds of motions and
    seconds, and of their differences in the same worlds. A world without such trials, as
    where a lifetime was over before, is left out; None where none is left, and of a change relative to zero.
    """
    parts = [_part(suite, trials) for trials in criterion.trials()]
    chosen = []
    for trials, part in zip(criterion.trials(), parts, strict=True):
        rows = with_cost(results[results["agent"] == trials.agent], part)
        (agent,) = (each for each in suite.agents if each.label == trials.agent)
        if rows["world"].nunique() < suite.worlds_of(agent, part):
            return None
        chosen.append(_chosen(rows, trials))
    if criterion.measure == "kept":
        return _estimate(_kept(*chosen), criterion)
    if criterion.measure == "most_motions":
        return _most(chosen[0])
    values = [
        _values(trials, part, criterion).groupby(trials["world"]).mean().dropna()
        for trials, part in zip(chosen, parts, strict=True)
    ]
    if criterion.than is None:
        return _estimate(values[0], criterion)
    both = values[0].index.intersection(values[1].index)
    if both.empty:
        return None
    mine, others = (of_worlds[both].to_numpy() for of_worlds in values)
    if criterion.relative:
        if not others.any():
            return None
        return Measured(relative_change(others, mine), len(both))
    paired = paired_shares if is_share(criterion) else paired_motions
    return Measured(paired(mine, others, ENOUGH_TO_FAIL), len(both))


def is_share(criterion: Number) -> bool:
    """Whether its number is a share of trials, or a difference of such."""
    return criterion.measure not in ("motions", "seconds", *EXTREMES)


def _part(suite: Suite, trials: TrialsOf) -> ScenarioConfig | SweepConfig:
    return next(part for part in suite.parts if part.name == trials.scenario)


def _chosen(rows: pd.DataFrame, trials: TrialsOf) -> pd.DataFrame:
    """The rows of the trials."""
    if trials.trials is not None:
        first, last = trials.trials
        return rows[(rows["phase"] == "train") & rows["trial"].between(first - 1, last - 1)]
    if trials.value is not None:
        in_view = rows["in_view"].fillna(False).astype(bool)
        return rows[(rows["phase"] == "sweep") & in_view & (rows["value"] == trials.value)]
    held_out = with_clocks(rows)
    held_out = held_out[held_out["lifetime_motions"] >= (trials.motions or 0)]
    for clock in ("lifetime_motions", "stretch"):  # right before a change, where it comes just then
        held_out = held_out[held_out[clock] == held_out.groupby("world")[clock].transform("min")]
    return held_out


def _values(
    trials: pd.DataFrame, part: ScenarioConfig | SweepConfig, criterion: Number
) -> "pd.Series[float]":
    """The measure in each trial; NaN where it has none."""
    if criterion.look is not None:
        return seconds_per_reach(trials, part.env.max_episode_steps, criterion.look)
    columns = {"success": SUCCESS, "rendezvous": RENDEZVOUS, "motions": MOTIONS, "worst_world": MOTIONS}
    if criterion.measure in columns:
        return trials[columns[criterion.measure]].astype(float)
    if criterion.within is not None:
        return ((trials[RENDEZVOUS] == 1) & (trials["motions"] <= criterion.within)).astype(float)
    if criterion.measure == "far":
        return (trials["distance_mm"] > FAR_MM).astype(float)
    if criterion.measure == "near":
        return (trials["error_px"] <= NEAR_PX).astype(float)
    if criterion.measure == "first_motion":
        return (trials[f"motions_to_{FIRST_MOTION_PX}"] == 1).astype(float)
    expected, came = trials["expected_px"] <= EXPECTED_PX, trials[f"motions_to_{EXPECTED_PX}"] == 1
    return (expected == came).astype(float).where(trials["expected_px"].notna())


def _kept(now: pd.DataFrame, then: pd.DataFrame) -> "pd.Series[float]":
    """Of each world's trials that took few motions then, the share that does now."""
    few = {
        name: trials.set_index(["world", "trial"])[MOTIONS] <= FEW_MOTIONS
        for name, trials in (("now", now), ("then", then))
    }
    both = pd.DataFrame(few).dropna().astype(bool)
    return both.loc[both["then"], "now"].groupby("world").mean().astype(float)


def _most(trials: pd.DataFrame) -> Measured | None:
    """Motions that 95 % of the trials need no more of."""
    if trials.empty:
        return None
    most = np.quantile(trials[MOTIONS], 0.95, method="inverted_cdf")
    return Measured(Estimate(float(most)), trials["world"].nunique())


def _estimate(values: "pd.Series[float]", criterion: Number) -> Measured | None:
    if values.empty:
        return None
    found = values.to_numpy()
    if criterion.measure == "worst_world":
        return Measured(Estimate(float(found.max())), len(found))
    of_worlds = mean_share if is_share(criterion) else median_world
    return Measured(of_worlds(found, ENOUGH_TO_FAIL), len(found))


class Verdict(StrEnum):
    """What becomes of a claim, or of one of its criteria."""

    CONFIRMED = "confirmed"
    MIXED = "mixed"
    NOT_CONFIRMED = "not confirmed"
    VACUOUS = "vacuous"
    UNTESTED = "untested"


@dataclass(frozen=True, slots=True)
class JudgedClaim:
    """A claim with each criterion's number, if there is one, that of its null agent, and its verdict."""

    claim: Claim
    found: tuple[Measured | None, ...]
    nulls: tuple[Measured | None, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def verdict(self) -> Verdict:
        """That of all criteria where they agree; untested where one is, and none has failed; else mixed."""
        kinds = set(self.verdicts)
        if Verdict.UNTESTED in kinds and Verdict.NOT_CONFIRMED not in kinds:
            return Verdict.UNTESTED
        return kinds.pop() if len(kinds) == 1 else Verdict.MIXED


def margin(criterion: Criterion, found: Measured | None) -> float:
    """By how many half-intervals a number meets its threshold, of the half that points to it.

    Above 1 the whole interval meets it, from -1 down none does. NaN where there is no number, or too few
    worlds.
    """
    if found is None or found.worlds < ENOUGH_TO_FAIL:
        return math.nan
    value, low, high = found.estimate.value, found.estimate.low, found.estimate.high
    beyond, worse, better = value - (criterion.above or 0.0), value - low, high - value
    if criterion.below is not None:
        beyond, worse, better = criterion.below - value, better, worse
    half = worse if beyond > 0 else better
    return beyond / half if half > EQUAL else math.copysign(math.inf, beyond or -1.0)


def verdict_of(criterion: Criterion, found: Measured | None, null: Measured | None) -> Verdict:
    """What a number, and that of the null agent, come to: see `_HOW_TO_READ`."""
    mine, others = margin(criterion, found), margin(criterion, null)
    if mine <= -1:
        return Verdict.NOT_CONFIRMED
    if found is None or found.worlds < ENOUGH_WORLDS or math.isnan(others):
        return Verdict.UNTESTED
    if mine > 1 and others <= -1:
        return Verdict.CONFIRMED
    return Verdict.VACUOUS if min(mine, others) > 1 else Verdict.MIXED


def judge(results: pd.DataFrame, suite: Suite) -> list[JudgedClaim]:
    """All claims of a suite, by its results."""
    judged = []
    for claim in suite.claims:
        found = tuple(measured(results, suite, each) for each in claim.criteria)
        nulls = tuple(measured(results, suite, each.by_null()) for each in claim.criteria)
        verdicts = tuple(map(verdict_of, claim.criteria, found, nulls))
        judged.append(JudgedClaim(claim, found, nulls, verdicts))
    return judged


def claims_section(judged: Sequence[JudgedClaim]) -> Section:
    """Each claim, its verdict, and the numbers behind it."""
    verdicts, rows, summary = [], [], []
    for each in judged:
        claim, name = each.claim, each.claim.name.replace("_", " ")
        verdicts.append([name, claim.words, claim.kind, claim.section, str(each.verdict)])
        judgements = zip(claim.criteria, each.found, each.nulls, each.verdicts, strict=True)
        for i, (criterion, found, null, verdict) in enumerate(judgements):
            asked = f"{described(criterion)}: {threshold(criterion)}"
            own, others = with_margin(criterion, found), with_margin(criterion, null)
            rows.append(["" if i else name, asked, own, f"{criterion.null_agent}: {others}", str(verdict)])
            for agent, what, of in (
                (criterion.of.agent, verdict, found),
                (criterion.null_agent, "null agent", null),
            ):
                where = criterion.of.scenario, "claims", str(agent), f"{claim.name}.{i}"
                number, worlds = (of.estimate, of.worlds) if of else (None, 0)
                summary.append(summary_row(*where, f"{criterion.measure}: {what}", number, worlds))
    of_claims = ["claim or question", "in words", "kind", "section", "verdict"]
    of_criteria = ["claim or question", "criterion", "measured", "null agent", "verdict"]
    remarks = " ".join(f"{each.claim.words} {each.claim.remark}" for each in judged if each.claim.remark)
    return Section(
        title="Claims",
        text=" ".join(verdicts_in_words(judged)),
        tables=(
            Table.of("verdicts", "Verdicts", of_claims, verdicts),
            Table.of("claims", "What was measured", of_criteria, rows),
        ),
        note=f"{_HOW_TO_READ} {remarks}".strip(),
        summary=summary,
    )


def with_margin(criterion: Criterion, found: Measured | None) -> str:
    """A criterion's number with its interval and, in round brackets, its margin."""
    by, said = margin(criterion, found), number_of(criterion, found)
    return said if math.isnan(by) else f"{said} ({written(by, '+.1f')})"


def required_section(results: pd.DataFrame, suite: Suite) -> Section:
    """Each number that is required, and whether it was met."""
    rows = [_required(each, measured(results, suite, each)) for each in suite.required]
    table = Table.of("required", "What is required", ["of", "measured", "required", "met"], rows)
    return Section(title="What is required", tables=(table,), note=_HOW_REQUIRED)


def _required(requirement: Requirement, found: Measured | None) -> list[str]:
    least, bound = requirement.at_least is not None, requirement.at_least
    if bound is None:
        bound = requirement.at_most
    assert bound is not None
    met = "unfinished"
    if found is not None:
        value = found.estimate.value
        met = "yes" if (value >= bound if least else value <= bound) else "NO"
    shares = requirement.relative or is_share(requirement)
    required = f"at {'least' if least else 'most'} {f'{100 * bound:g} %' if shares else f'{bound:g}'}"
    return [described(requirement), number_of(requirement, found), required, met]


def described(criterion: Number) -> str:
    """What a criterion measures, in words."""
    look = f", {criterion.look:g} s a look" if criterion.look else ""
    within = f" in {counted(criterion.within, 'motion')} at most" if criterion.within else ""
    words = f"{_in_words(criterion.of)}: {_MEASURES[criterion.measure]}{look}{within}"
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
    return f"{sign} {written(bound, '.0%') if shares else f'{bound:g}'}"


def _in_words(trials: TrialsOf) -> str:
    return f"{trials.agent}, {trials.scenario}, {_when(trials)}"


def _when(trials: TrialsOf) -> str:
    if trials.trials is not None:
        first, last = trials.trials
        return f"own trial {first}" if first == last else f"own trials {first}–{last}"
    if trials.motions is not None:
        return f"after {trials.motions:,} motions"
    return f"at {trials.value:g}"


def verdicts_in_words(judged: Sequence[JudgedClaim]) -> tuple[str, ...]:
    """Which claims stand, which fell, and how the paper's questions are answered: a sentence each."""
    return tuple(
        f"Of {counted(len(of_kind), kind)} {_counted(of_kind)}."
        for kind in ("claim", "question")
        if (of_kind := [each for each in judged if each.claim.kind == kind])
    )


def _counted(judged: Sequence[JudgedClaim]) -> str:
    by_verdict = {
        verdict: [each.claim.name.replace("_", " ") for each in judged if each.verdict is verdict]
        for verdict in Verdict
    }
    return "; ".join(
        f"{len(names)} {'is' if len(names) == 1 else 'are'} {verdict} ({', '.join(names)})"
        for verdict, names in by_verdict.items()
        if names
    )
