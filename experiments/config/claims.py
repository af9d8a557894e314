"""What a paper claims, and how it is put to the test: read from YAML into frozen models."""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from experiments.config.model import Model, Name

Measure = Literal["success", "rendezvous", "motions", "seconds", "first_motion", "as_expected", "kept"]
"""What is measured in a trial, and averaged over the trials of a world:

- success: the true error at the end is within the tolerance.
- rendezvous: the last observation was.
- motions: motions of a reach; a trial without a rendezvous counts as the cap.
- seconds: robot seconds of a reach, where a look takes `look` seconds; without a rendezvous it goes on to the
  cap at its own pace.
- first_motion: the true error after the first motion is within 4 px.
- as_expected: the agent told before that its first motion would bring it within 16 px, and it did, or told
  nothing of the kind, and it did not.
- kept: of the held-out trials that took at most two motions at the moment `than`, the share that still do.
"""


class Moment(Model):
    """Trials of an agent: its own, held-out ones, or those at one value of a sweep.

    Attributes:
        agent: Its label.
        scenario: Name of the scenario or sweep.
        trials: First and last of its own trials, from 1.
        motions: Lifetime motions after which held-out trials were made: at the first checkpoint from there.
        value: Of what the sweep varies.
    """

    agent: Name
    scenario: Name
    trials: tuple[int, int] | None = Field(None, strict=False)
    motions: int | None = Field(None, ge=0)
    value: float | None = Field(None, strict=False)

    @model_validator(mode="after")
    def _one_kind_of_trials(self) -> "Moment":
        given = [name for name in ("trials", "motions", "value") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            raise ValueError(f"one of trials, motions and value says which trials; found {found}")
        if self.trials and not 1 <= self.trials[0] <= self.trials[1]:
            raise ValueError(f"trials are the first and the last one, from 1; found {list(self.trials)}")
        return self


class Criterion(Model):
    """One number of the results, and what it must be.

    Attributes:
        measure: See `Measure`.
        of: Of which trials.
        than: If given, the number is by how much `of` differs from it, world by world.
        relative: Whether that is told as a share of what it is at `than`.
        look: Seconds that a look takes, for seconds.
        at_least: The claim holds from this on.
        at_most: The claim holds up to this.
    """

    measure: Measure
    of: Moment
    than: Moment | None = None
    relative: bool = False
    look: float | None = Field(None, gt=0, strict=False)
    at_least: float | None = Field(None, strict=False)
    at_most: float | None = Field(None, strict=False)

    @model_validator(mode="after")
    def _complete(self) -> "Criterion":
        if (self.at_least is None) == (self.at_most is None):
            raise ValueError("one of at_least and at_most is the threshold")
        if (self.measure == "seconds") != (self.look is not None):
            raise ValueError("seconds need look, the seconds that a look takes; other measures have none")
        if self.relative and self.than is None:
            raise ValueError("relative needs than, what it is relative to")
        if self.measure == "kept" and (self.than is None or self.relative):
            raise ValueError("kept needs than, the earlier moment, and is a share already")
        return self


class Claim(Model):
    """A claim of the paper.

    Attributes:
        name: Ours.
        section: Of the paper.
        words: The claim in our words.
        tests: It is confirmed where all of them pass.
        remark: What the tests do not show.
    """

    name: Name
    section: str
    words: str
    criteria: tuple[Criterion, ...] = Field(min_length=1, strict=False)
    remark: str = ""

    def moments(self) -> Iterator[tuple[int, Moment]]:
        """All moments that its tests are about, each with the test's index."""
        for i, criterion in enumerate(self.criteria):
            yield i, criterion.of
            if criterion.than:
                yield i, criterion.than
