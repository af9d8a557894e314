"""How fast it is, as a user feels it: motions, worlds, pictures, decisions, and training beside others."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, Self

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from calfree_gym.robot.simulation import SUBSTEPS
from calfree_gym.sb3 import make_sb3_env
from experiments.errors import ConfigError
from experiments.reporting.figures import STYLE, LineEnd, label_lines, say
from experiments.reporting.tables import Table
from experiments.studies.speed import peer_worker
from experiments.studies.speed.motions import (
    Line,
    bare_scene,
    by_rows,
    in_turns,
    lines,
    pinned,
    ratios,
    stepping,
    timer,
    written,
)
from experiments.studies.speed.peer_worker import SHARE, reached_by_ppo

ROUNDS = 60
PACKAGES = "mujoco", "gymnasium", "numpy", "stable-baselines3", "torch"
_COLOURS = {"kinematic": "#003F8F", "physics": "#B84300"}


def tables(peers: Sequence[str] = (), rounds: int = ROUNDS) -> Iterator[Table]:
    """What takes how long; and motions a second, by how many arms move at once.

    Pairs are timed so many times, of what is slow fewer.
    """
    machine: dict[str, Any] = {"cores": os.cpu_count(), "python": platform.python_version()}
    machine |= {name: version(name) for name in PACKAGES}
    with ExitStack() as stack:
        others = [stack.enter_context(Peer(spec)) for spec in peers]
        found = [*ratios(rounds), *lines(rounds)]
        found += chain.from_iterable(beside(peer, max(rounds // 3, 1)) for peer in others)
        for peer in others:
            machine[peer.env_id] = " ".join(f"{name} {of}" for name, of in peer.versions.items())
    told = ", ".join(f"{name} {of}" for name, of in machine.items())
    yield _table(found, f"Medians over rounds; ratios are medians of pairs that were timed in turns. {told}")
    frame = by_rows(max(rounds // 6, 1))
    formats = dict.fromkeys(frame.columns, ",.0f")
    yield Table("rows", "Motions a second", frame, formats, f"All rows together, truth=False. {told}")


def _table(found: Sequence[Line], note: str) -> Table:
    columns = ["ours / beside it", "ours", "beside it", "times as fast", "required"]
    rows = [(line.what, written(line.seconds), written(line.beside), *line[3:]) for line in found]
    formats = {"times as fast": ".3g", "required": ".2g"}
    return Table("speed", "What takes how long", pd.DataFrame(rows, columns=columns), formats, note)


def figure(found: Sequence[Table]) -> Figure:
    """Motions a second against rows."""
    frame = next(table.frame for table in found if table.name == "rows")
    rows = frame["rows"].astype(float)
    with plt.rc_context(STYLE):
        drawn, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
        axes.set(xscale="log", yscale="log", xlabel="arms that move at once (num_envs)")
        axes.set_xlim(rows.min(), rows.max())
        ends = []
        for name in frame.columns.drop("rows"):
            speeds, colour = frame[name].astype(float), _COLOURS[name.split(",")[0]]
            axes.plot(rows, speeds, color=colour, linestyle="-" if "1 thread" in name else "--", marker="o")
            ends.append(LineEnd(rows.iloc[-1], speeds.iloc[-1], name, colour))
        say(drawn, "Motions a second, all arms together", "The nominal world, points, truth=False.")
        label_lines(axes, ends, 10)
    return drawn


# -- Other environments under other interpreters, timed in turns with ours

WORKER = Path(peer_worker.__file__)
LONGEST = 0.25
"""Of PPO's words, as docs/learning.md advises: peers bound theirs, too. (Panda-gym: 5 cm a step.)"""
WORLD: dict[str, Any] = {"world": "nominal", "dynamics": "kinematic", "word_limit": LONGEST}
"""In which PPO learns to reach."""


def beside(peer: Peer, rounds: int) -> Iterator[Line]:
    """One arm of ours and one of the peer's: a step, a simulated second, and PPO until it reaches.

    Beside rows of a peer's, a step of as many.
    """
    if (rows := peer.rows) > 1:
        for dynamics, steps in (("kinematic", 50), ("physics", 4)):
            ours = timer(stepping(rows, steps, dynamics=dynamics, truth=False, threads=1), steps)
            what = f"a step of {rows} {dynamics} rows, one thread / of {rows} of {peer.env_id}"
            with pinned(1):
                yield in_turns(what, ours, lambda: peer.seconds(50) / 50, rounds)
        return
    ours = timer(stepping(1, 50), 50)
    with pinned(1):
        line = in_turns(f"a step of one arm / {peer.env_id}", ours, lambda: peer.seconds(50) / 50, rounds)
        yield line
        if peer.substeps and peer.timestep:
            mine, others = SUBSTEPS * float(bare_scene().model.opt.timestep), peer.substeps * peer.timestep
            yield Line(
                f"a simulated second of one arm / {peer.env_id}",
                line.seconds / mine,
                (line.beside or 0) / others,
                (line.ratio or 0) * mine / others,
            )
        if other := peer.reached_by_ppo():
            own = _reached_by_our_ppo()
            mine_is = f"64 kinematic rows, words up to {LONGEST}{_given_up(own)}"
            theirs_is = f"{peer.env_id}{_given_up(other)}"
            yield Line(
                f"PPO until {SHARE:.0%} of trials reach, {mine_is} / {theirs_is}",
                own["seconds"],
                other["seconds"],
                other["seconds"] / own["seconds"],
            )


@cache
def _reached_by_our_ppo() -> dict[str, Any]:
    return reached_by_ppo(make_sb3_env(seed=0, **WORLD))


def _given_up(found: dict[str, Any]) -> str:
    return "" if found["reached"] else f" (not in {found['motions']:,} motions)"


class Peer:
    """An environment in a process of its own, which steps only while it is being timed.

    "PYTHON=ENV_ID" names an interpreter that has it, and its id, "module:Id" and "envpool:Id" included.
    Substeps of a step, and their seconds, are None where they are not known.
    """

    def __init__(self, spec: str) -> None:
        self._spec = spec
        python, _, self.env_id = spec.rpartition("=")
        if not (python and self.env_id):
            raise ConfigError(f"--peer {spec}: found no PYTHON=ENV_ID; allowed: such as python3=CartPole-v1")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the process; a pipe would fill up)
        try:
            self._process = subprocess.Popen(
                [python, "-c", WORKER.read_text(encoding="utf-8"), self.env_id],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                text=True,
            )
        except OSError as error:
            self._said.close()
            raise ConfigError(f"--peer {spec}: {python} cannot be run: {error.strerror}") from None
        try:
            about = self._answer()
        except ConfigError:
            self.close()
            raise
        self.substeps: int | None = about["substeps"]
        self.timestep: float | None = about["timestep"]
        self.rows: int = about["rows"]
        self.versions: dict[str, str] = about["versions"]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()
        self._said.close()

    def seconds(self, steps: int) -> float:
        """Makes this many environment steps; returns the seconds that they took."""
        return float(self._asked(str(steps))["seconds"])

    def reached_by_ppo(self) -> dict[str, Any]:
        """What `peer_worker.reached_by_ppo` returns."""
        found: dict[str, Any] = self._asked("ppo")
        return found

    def _asked(self, line: str) -> Any:
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # no answer then says why
            self._process.stdin.write(f"{line}\n")
            self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        answer: Any = None
        with suppress(ValueError):
            answer = json.loads(line)
        if not isinstance(answer, dict):
            raise ConfigError(f"--peer {self._spec}: {self._last_words(line)}")
        if "error" in answer:
            raise ConfigError(f"--peer {self._spec}: {answer['error']}")
        return answer

    def _last_words(self, line: str) -> str:
        if line:
            return f"answered {line.strip()!r}; PYTHON must be a Python with gymnasium"
        code = self._process.wait()
        self._said.seek(0)
        said = self._said.read().decode(errors="replace").strip().splitlines()
        return f"it ended with code {code}" + (f": {said[-1]}" if said else "")
