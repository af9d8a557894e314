"""What the CPU seconds of a run were spent on."""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from experiments.evaluation import Predictor

CPU = "cpu_seconds_a_motion"
"""In what a run says about itself; it stands beside the results, which are the same in each repetition."""


class CpuTimes:
    """CPU seconds, and how often each was begun; what is measured within something else does not count."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self.times: Counter[str] = Counter()
        self._running: list[str] = []
        self._since = 0.0

    @contextmanager
    def of(self, what: str) -> Iterator[None]:
        """Counts what is done within."""
        self._book()
        self._running.append(what)
        self.times[what] += 1
        try:
            yield
        finally:
            self._book()
            self._running.pop()

    def watch(self, what: Any, name: str, *methods: str) -> None:
        """Counts these methods of an object from now on."""
        for method in methods:
            setattr(what, method, self._timed(getattr(what, method), name))

    def _timed(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            with self.of(name):
                return function(*arguments, **options)

        return timed

    def a_motion(self, learned: int) -> dict[str, float]:
        """Seconds of a decision, and of learning from a motion (with its decision), where there was any."""
        found = {}
        if self.times["decision"]:
            found["decision"] = self.seconds["decision"] / self.times["decision"]
        if learned:
            found["learning"] = self.seconds["learning"] / learned
        return found

    def _book(self) -> None:
        now = time.process_time()
        if self._running:
            self.seconds[self._running[-1]] += now - self._since  # type: ignore[assignment]
        self._since = now


class TimedPredictor:
    """An agent whose decisions are timed."""

    def __init__(self, agent: Predictor, times: CpuTimes):
        self.agent = agent
        self.expected_px = getattr(agent, "expected_px", None)
        self._times = times

    def predict(self, *arguments: Any, **options: Any) -> tuple[Any, Any]:
        """As the agent's."""
        with self._times.of("decision"):
            return self.agent.predict(*arguments, **options)
