"""`python -m experiments tune`: several agents, one after the other or at once, and what is published."""

import argparse
import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import optuna
import pandas as pd
import yaml

from experiments.errors import ConfigError
from experiments.options import Parser, add_config, whole
from experiments.reporting.kept_tables import page_of
from experiments.reporting.pages import MARKDOWN
from experiments.reporting.tables import Table, number, show
from experiments.running.process import end_idle_workers
from experiments.running.results_folder import (
    locked,
    made_folder,
    read_json,
    refuse_links,
    write_json,
    write_whole,
)
from experiments.running.versions import REPOSITORY, commit, versions
from experiments.statistics import Estimate
from experiments.tuning.config import TunedAgentConfig, TuningConfig, load_tuning
from experiments.tuning.tuner import DefaultsFailError, Lifetimes, LostError, Tuner

STUDIES = "studies"


def add_tune(parser: Parser) -> None:
    """Tunes agents."""
    add_config(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--jobs", type=whole(1), default=1, help="agents at a time (default: 1)")
    parser.add_argument("--agent", nargs="+", default=[], metavar="NAME", help="these alone")
    parser.add_argument("--write", action="store_true", help="write better settings into configs/agents")
    parser.set_defaults(does=_tune)


def _tune(options: argparse.Namespace) -> int:
    """Goes on with what stands in the folder; the tries of an agent follow each other, as each learns."""
    config, out = load_tuning(options.config, options.set), options.out
    try:
        agents = config.only(options.agent).agents if options.agent else config.agents
    except ValueError as error:
        raise ConfigError(f"--agent: {error}") from None
    refuse_links(out / STUDIES)
    made_folder(out / STUDIES)
    with locked(out):
        made_by = {**versions(("experiments/tuning",)), "optuna": optuna.__version__}
        lifetimes, by = Lifetimes(made_by), commit()
        tuners = [Tuner(config, each, out / STUDIES, lifetimes.make, made_by, by, _say) for each in agents]
        pool = ThreadPoolExecutor(options.jobs)
        tuned = [pool.submit(_tuned, tuner, out) for tuner in tuners]
        try:
            found = [each.result() for each in tuned]
        finally:  # each agent whose worker was ended begins no other
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(each.done() for each in tuned):
                lifetimes.stop()
                time.sleep(0.1)
            end_idle_workers()
        show(write_tables(out, config))
    for each in found:
        if each and each["choice"] == "tuned":
            _offer(each, options.write)
    return int(None in found)


def _tuned(tuner: Tuner, out: Path) -> dict[str, Any] | None:
    """What became of an agent; None where its tuning failed, which stops no other."""
    try:
        found = tuner.tune()
    except (DefaultsFailError, LostError) as error:
        print(f"{tuner.name}: FAILED: {error}", file=sys.stderr)
        return None
    write_agent(out, found)
    _say(f"{tuner.name}: {found['choice']} settings, stopped by {found['stopped_by']}")
    return found


def _offer(found: dict[str, Any], write: bool) -> None:
    """Writes or prints the settings that beat the default ones."""
    path = SETTINGS / f"{found['agent']['name']}.yaml"
    text = settings_file(found)
    if write:
        write_whole(path, text)
    _say(f"{path.relative_to(REPOSITORY)}{'' if write else ', which --write writes'}:\n{text}")


def _say(text: str) -> None:
    print(text, flush=True)


CHOICES = "choices"
SETTINGS = REPOSITORY / "configs" / "agents"
"""Where tuned settings of agents stand."""

_DIFFERENCE = "best less default there"
_NOTE = (
    "Motions a held-out reach, mean over the checkpoints of a lifetime and over worlds: lower is better. The "
    "default settings stay, unless the whole 95 % interval of the paired difference in other worlds, where "
    "nothing was tried, favours the best ones. Where no try was better, there is nothing to compare."
)


def write_agent(out: Path, found: dict[str, Any]) -> None:
    """Writes AGENT.json: all that `Tuner.tune` returned, and its tries as a table."""
    write_json(out / f"{found['agent']['name']}.json", {**found, "tables": [_tries(found).to_dict()]})


def write_tables(out: Path, config: TuningConfig) -> list[Table]:
    """Writes choices.json and report.md, of all agents tuned in a folder; returns their tables."""
    files = [out / f"{agent.name}.json" for agent in config.agents]
    found = [read_json(file) for file in files if file.exists()]
    if not found:
        return []
    tables = [_choices(found), _ranges(found)]
    commits = ", ".join(dict.fromkeys(each["commit"] for each in found))
    kept = out / f"{CHOICES}.json"
    write_json(kept, {"commit": commits, "tables": [table.to_dict() for table in tables]})
    write_whole(out / MARKDOWN, page_of(kept, out.name))
    return tables


def settings_file(found: dict[str, Any], folder: Path = SETTINGS) -> str:
    """configs/agents/NAME.yaml with the chosen settings in it, whatever else stands there kept."""
    name, settings = found["agent"]["name"], found["settings"]
    path = folder / f"{name}.yaml"
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    see = f"tuned, see experiments/results/tuning/{name}.json"
    head = (
        f"# {', '.join(settings)}: {see}; what follows was measured before." if text else f"# {name}: {see}."
    )
    wanted = {**(yaml.safe_load(text) or {}), **settings}
    for setting, value in settings.items():
        line = f"{setting}: {_yaml(value)}"
        text, replaced = re.subn(rf"^{setting}:[^#\n]*?(?=\s*(#|$))", line, text, flags=re.MULTILINE)
        if not replaced:
            text += f"{line}\n"
    text = f"{head}\n{text}"
    if yaml.safe_load(text) != wanted:
        raise ConfigError(f"{path} gives {', '.join(settings)} over several lines: change it by hand")
    return text


def _yaml(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("\n").removesuffix("\n...")


def _choices(found: list[dict[str, Any]]) -> Table:
    """One row an agent: tries, cost, and who won in other worlds."""
    rows = []
    for each in found:
        tries, check = each["tries"], each["check"]
        row = {
            "agent": f"`{each['agent']['name']}`",
            "tries": len(tries),
            "CPU min": each["cpu_minutes"],
            "default": tries[0]["objective"],
            "best": min((made["objective"] for made in tries if made["objective"] is not None), default=None),
            "other worlds": "",
            _DIFFERENCE: None,
            "CPU min there": None,
        }
        if check:
            row |= {"other worlds": f"{len(check['default'])}", "CPU min there": check["cpu_minutes"]}
            row[_DIFFERENCE] = number(Estimate(**check["difference"]), 2)
        rows.append(row | {"choice": each["choice"], "stopped by": each["stopped_by"]})
    formats = {"default": ".2f", "best": ".2f", "CPU min": ".1f", "CPU min there": ".1f"}
    return Table(CHOICES, "Default and tuned settings", pd.DataFrame(rows), formats, _NOTE)


def _ranges(found: list[dict[str, Any]]) -> Table:
    """One row a setting: where it was varied, and what was best."""
    rows = []
    for each in found:
        agent = TunedAgentConfig.model_validate(each["agent"])
        for name, within in (*agent.ranges.items(), *agent.choices.items()):
            text = ", ".join(map(_yaml, within)) if isinstance(within, list) else str(within)
            best = each["best"] or {}
            rows.append(
                {
                    "agent": f"`{agent.name}`",
                    "setting": f"`{name}`",
                    "tried": text,
                    "default": _yaml(each["default"][name]),
                    "best": _yaml(best[name]) if name in best else "",
                    "chosen": _yaml(each["settings"][name]),
                }
            )
    return Table("ranges", "What was varied", pd.DataFrame(rows))


def _tries(found: dict[str, Any]) -> Table:
    """One row a try."""
    rows = [
        {
            "try": k,
            **{name: _yaml(value) for name, value in made["settings"].items()},
            "motions per reach": made["objective"],
            "worlds": len(made["worlds"]),
            "CPU s": made["cpu_seconds"],
            "outcome": made["state"],
        }
        for k, made in enumerate(found["tries"])
    ]
    name = found["agent"]["name"]
    formats = {"motions per reach": ".2f", "CPU s": ".1f"}
    return Table(name, f"Tries of {name}", pd.DataFrame(rows), formats, f"Stopped by {found['stopped_by']}.")
