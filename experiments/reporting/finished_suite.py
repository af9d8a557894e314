"""A suite that was run, and what several parts of the report need: worlds, rows, how far trials end."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from experiments.config.environment import EnvironmentConfig, as_told
from experiments.config.in_words import again_and_again, schedule_in_words
from experiments.config.suite import AgentConfig, ScenarioConfig, Suite, SweepConfig
from experiments.reporting.pages import SummaryRow, summary_row
from experiments.reporting.tables import Table, counted, must_know, percent, written
from experiments.running.run import Run
from experiments.statistics import ENOUGH_WORLDS, Estimate, mean_share

SUCCESS, RENDEZVOUS, MOTIONS, SECONDS = "success", "rendezvous", "motions_per_reach", "robot_seconds"
"""What is measured in a trial; one without an observed rendezvous counts as the cap in motions per reach."""


@dataclass(frozen=True, slots=True)
class FinishedSuite:
    """What a suite has come to so far.

    Attributes:
        out: Where its report stands.
        command: What makes it, in any folder and on any number of processes.
        outcomes: What the finished ones say about themselves, by their ids.
        failures: The last lines that failed ones printed, by their ids.
        versions: The commit, and what else made the finished ones; several versions where they differ.
        results: All rows of the finished ones.
        timings: Seconds of the finished ones, one a row, as far as they are known.
    """

    out: Path
    suite: Suite
    command: str
    runs: list[Run]
    outcomes: dict[str, dict[str, Any]]
    failures: dict[str, list[str]]
    versions: dict[str, str]
    results: pd.DataFrame
    timings: pd.DataFrame

    @property
    def unfinished(self) -> list[Run]:
        """Runs that failed, or were never finished."""
        return [run for run in self.runs if run.id not in self.outcomes]

    @property
    def head_part(self) -> ScenarioConfig | SweepConfig:
        """What its head is about: its first scenario with a knock and held-out trials, if any."""
        held_out = [each for each in self.suite.scenarios if self.suite.evaluation_of(each)]
        knocked = [each for each in held_out if each.is_knocked]
        return (*knocked, *held_out, *self.suite.parts)[0]

    def runs_of(self, agent: AgentConfig) -> list[str]:
        """The ids of the finished runs of an agent."""
        return [run.id for run in self.runs if run.agent.label == agent.label and run.id in self.outcomes]

    def must_know(self, agent: AgentConfig) -> str:
        """The privileged observations of an agent, and what it is built on."""
        if (outcome := self.outcome_of(agent)) is None:
            return "unknown: no run finished"
        return must_know(outcome["privileged"], outcome["prior_knowledge"])

    def outcome_of(self, agent: AgentConfig) -> dict[str, Any] | None:
        """What the first finished run of an agent says about itself, if any has finished."""
        own = (run.id for run in self.runs if run.agent.label == agent.label)
        return next((self.outcomes[run] for run in own if run in self.outcomes), None)

    def worlds_in(self, part: ScenarioConfig | SweepConfig) -> dict[str, int]:
        """In how many worlds, the first ones of the suite's, each agent of a part is, by its label."""
        return {agent.label: self.suite.worlds_of(agent, part) for agent in self.suite.agents_in(part)}

    def compared(self, part: ScenarioConfig) -> str:
        """In brackets, whether all agents met the same in each world of a scenario, where runs tell.

        Of changes that come again and again they do not: longer lives meet more.
        """
        met: dict[int, dict[str, str]] = {}
        for run in self.runs:
            where, found = run.where, self.outcomes.get(run.id, {}).get("met")
            if where["scenario"] == part.name and found:
                met.setdefault(where["world"], {})[where["agent"]] = found
        other = [str(world) for world, found in sorted(met.items()) if len({*found.values()}) > 1]
        if other:
            return f" (but not all met the same in worlds {', '.join(other)})"
        equal = "they began" if again_and_again(part) else "they and their changes were"
        return f" ({equal} equal)" if any(len(found) > 1 for found in met.values()) else ""

    def fewest_worlds(self, part: ScenarioConfig | SweepConfig) -> int:
        """In how many worlds that agent of a part is that is in the fewest."""
        return min(self.worlds_in(part).values())


def with_cost(results: pd.DataFrame, scenario: ScenarioConfig | SweepConfig) -> pd.DataFrame:
    """The rows of one scenario or sweep, with motions per reach.

    A trial without a rendezvous counts as the cap.
    """
    rows = results[results["scenario"] == scenario.name].copy()
    rows[[SUCCESS, RENDEZVOUS]] = rows[[SUCCESS, RENDEZVOUS]].astype(float)
    rows[MOTIONS] = rows["motions"].where(rows[RENDEZVOUS] == 1, scenario.env.max_episode_steps).astype(float)
    return rows


def few_worlds(finished: FinishedSuite, part: ScenarioConfig | SweepConfig) -> str:
    """What fewer worlds than are enough do not show."""
    worlds = finished.worlds_in(part)
    few = [label for label in worlds if worlds[label] < ENOUGH_WORLDS]
    if len(few) < len(worlds):
        than = f"in fewer than {ENOUGH_WORLDS} worlds: no intervals, and not ranked"
        return f" {', '.join(few)} {'is' if len(few) == 1 else 'are'} {than}." if few else ""
    fewest = finished.fewest_worlds(part)
    return f" {counted(fewest, 'world')}, fewer than {ENOUGH_WORLDS}: no intervals, and nobody is ranked."


def about(finished: FinishedSuite, scenario: ScenarioConfig) -> str:
    """What the runs of a scenario have in common, in words."""
    worlds = {*finished.worlds_in(scenario).values()}
    _, of = scenario.length
    lives = {run.work[0] for run in finished.runs if run.where["scenario"] == scenario.name}
    met = schedule_in_words(scenario)
    changes = f" {met[0].upper()}{met[1:]}." if met else ""
    return (
        f"{about_environment(scenario.env)}; at most {scenario.env.max_episode_steps} motions a trial, "
        f"{_span(lives)} {of} a life, {_span(worlds)} world{'s' * (max(worlds) > 1)}, the same ones for "
        f"every agent{finished.compared(scenario)}.{changes}{few_worlds(finished, scenario)}"
    )


def judged_alike(parts: Sequence[ScenarioConfig | SweepConfig]) -> bool:
    """Whether they may stand side by side: as many motions for a failure, one tolerance, as many worlds."""
    return len({(each.env.max_episode_steps, each.env.tolerance_px, each.worlds) for each in parts}) == 1


def _span(amounts: set[int]) -> str:
    return f"{min(amounts):,} to {max(amounts):,}" if len(amounts) > 1 else f"{max(amounts, default=0):,}"


def about_environment(env: EnvironmentConfig) -> str:
    """An environment in words; of an arm that is not built in, its model's name, motors and digest."""
    others = env.model_dump(exclude_defaults=True, exclude=_SAID)
    ends = f"tolerance {env.tolerance_px:g} px, {env.dynamics} dynamics"
    ends += "".join(f", {name} {value}" for name, value in others.items())
    if env.task == "dock":
        return f"{env.id}, {env.world} worlds, {env.base} base, {ends}"
    arm = ""
    if not isinstance(env.arm, str):
        told = as_told(env.arm)
        arm = f" arm {told['model']} (motors {', '.join(told['motors'])}; digest {told['digest'][:12]}),"
    mounts = env.camera_mount if isinstance(env.camera_mount, str) else " and ".join(env.camera_mount)
    return f"{env.id}, {env.world} worlds,{arm} cameras on the {mounts}, {ends}"


SUCCESS_IN_WORDS = (
    "Success: the true error at the end is within the tolerance (in grasping: lifted; in inserting: in the "
    "hole)."
)
_SAID = {"id", "world", "arm", "base", "camera_mount", "tolerance_px", "dynamics"}
"""Of an environment, what its words always tell."""


def where_it_stands(part: ScenarioConfig | SweepConfig, trials: str, worlds: Collection[int]) -> str:
    """What stands below a figure before its lines are explained: trials, in how many worlds, tolerance."""
    fewest, most = min(worlds), max(worlds)
    amount = counted(most, "world") if fewest == most else f"{fewest} to {counted(most, 'world')}"
    return f"{trials}, in {amount}; tolerance: {part.env.tolerance_px:g} px of 512."


FAR_MM = 10
"""A trial that ends farther off is far. Choice: what a gripper that opens by some centimetres forgives."""
HOW_FAR = (
    " How far in the world: the true distance of gripper and object at the end of a trial, whether a "
    "rendezvous was observed or not. Half of the trials end within the median, 95 % within the next number; "
    f"the share that ends more than {FAR_MM} mm off is a mean over worlds with its 95 % interval. A run that "
    "did not finish has none."
)


class Distances(NamedTuple):
    """True distances at the end of trials, in mm.

    Attributes:
        median, most: Within which half, and 95 %, of all trials end: these have no interval.
        far: The share of trials that end more than `FAR_MM` off, mean over worlds.
        worlds: How many.
    """

    median: float
    most: float
    far: Estimate
    worlds: int


def distances(trials: pd.DataFrame) -> Distances:
    """Those of at least one trial, rows of results."""
    found = trials["distance_mm"]
    far = (found > FAR_MM).groupby(trials["world"]).mean().to_numpy(float)
    return Distances(float(found.median()), float(found.quantile(0.95)), mean_share(far), len(far))


def distance_tables(
    name: str,
    env: EnvironmentConfig,
    columns: Sequence[str],
    found: Iterable[tuple[Sequence[str], Distances]],
) -> tuple[Table, ...]:
    """One table of a scenario or sweep where its task is to reach; none of other tasks."""
    if env.task != "reach":
        return ()
    rows = [
        [*names, written(each.median, ".1f"), written(each.most, ".1f"), percent(each.far, 1)]
        for names, each in found
    ]
    columns = [*columns, "median (mm)", "95 % within (mm)", f"above {FAR_MM} mm"]
    return (Table.of(f"{name}-distance", f"{name}, how far in the world", columns, rows),)


def distance_rows(scenario: str, table: str, agent: str, moment: str, found: Distances) -> list[SummaryRow]:
    """Rows of the report's summary; see `summary_row`."""
    measured = (("distance_mm", found.median), ("distance_mm_95", found.most), ("far", found.far))
    return [
        summary_row(scenario, table, agent, moment, measure, each, found.worlds) for measure, each in measured
    ]
