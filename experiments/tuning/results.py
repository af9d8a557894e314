"""What tuning came to: a file for each agent, and tables of all."""

import re
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from experiments.errors import ConfigError
from experiments.reporting.documents.benchmark_report import MARKDOWN, write_page
from experiments.reporting.tables import Table, number
from experiments.running.results_folder import read_json, write_json
from experiments.running.versions import REPOSITORY
from experiments.statistics import Estimate
from experiments.tuning.config import TunedAgentConfig, TuningConfig

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
    write_page(kept, out / MARKDOWN)
    return tables


def settings_file(found: dict[str, Any], folder: Path = SETTINGS) -> str:
    """configs/agents/NAME.yaml with the chosen settings in it, whatever else stands there kept.

    Raises:
        ConfigError: One of the settings stands there over several lines.
    """
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
