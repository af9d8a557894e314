"""A robot on wheels docks in a few arcs, planned by a projective model that it learns as it drives."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.checks import check_number, checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..base.storage import prefixed, under
from .observation import DockObservation
from .planner import Planner
from .projective_model import DrivenArc, ProjectiveModel, homography

Motions = Generator[Array, DockObservation, None]


class KnownOfArcs:
    """What is known of a robot: how words move marks, where its own are seen, and how far to rely on that.

    Attributes:
        model: How words move marks.
        goal: Where its own marks are seen (p, 2), as the mean of `looks`.
        looks: So many; none before the first trial.
        trust: The longest word that it relies on.

    Args:
        points: p: all marks in all cameras.
        motors: m.
        cameras: In which each mark is seen, in turn.
    """

    FIRST_TRUST = 0.15
    """Choice: a word that moves any robot well within the images."""
    KNOCKED_PX = 4.0
    """Its own marks are elsewhere than before where they are so far off in the median; a single one is
    mistaken. Derived: eight times the noise of a good marker."""
    LOOKS = 20
    """Of its own marks so many count (a guard: small knocks are to show)."""

    def __init__(self, points: int, motors: int, cameras: int) -> None:
        self.model, self._cameras = ProjectiveModel(points, motors, cameras), cameras
        self.goal, self.looks, self.trust = np.zeros((points, 2)), 0, self.FIRST_TRUST

    def look(self, goal: Array) -> bool:
        """Learns where its own marks are seen (p, 2); tells whether a camera was knocked.

        Then the model is carried over by the homographies between both views of them. Fewer than four marks
        tell none: it is learned anew.
        """
        off_px = lengths_px(goal - self.goal)
        of_cameras = np.median(off_px.reshape(-1, self._cameras), 0)
        knocked = bool(self.looks and of_cameras.max() > self.KNOCKED_PX)
        if knocked:
            if len(goal) < 4 * self._cameras:
                self.model = ProjectiveModel(len(goal), self.model.motors, self._cameras)
            else:
                was, now = self.model.straight(self.goal), self.model.straight(goal)
                views = [slice(camera, None, self._cameras) for camera in range(self._cameras)]
                self.model.carry_over(np.array([homography(was[view], now[view]) for view in views]))
            self.trust, self.looks = min(self.trust, self.FIRST_TRUST), 0
        right = (off_px < self.KNOCKED_PX) | (self.looks == 0)
        self.looks = min(self.looks + 1, self.LOOKS)
        self.goal = self.goal + right[:, None] * (goal - self.goal) / self.looks
        return knocked

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it, as named arrays."""
        numbers = {"goal": self.goal, "numbers": np.array([self.looks, self.trust])}
        return numbers | prefixed("model", self.model.arrays())

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""
        self.goal = checked_array(arrays, "goal", self.goal.shape)
        looks, self.trust = checked_array(arrays, "numbers", (2,)).tolist()
        self.looks = int(looks)
        if not (self.looks >= 0 and 0 < self.trust <= 1):
            raise ValueError(f"looks is {looks}, trust {self.trust}; allowed: 0 and more, above 0 to 1")
        self.model.restore(under("model", arrays))


@agent("arcs", "Learns how arcs move marks in images, and plans the fewest that dock.", tasks=("dock",))
class Arcs(ProcedureAgent):
    """Docks along the fewest arcs that a projective model expects to arrive.

    First it makes a few short motions. Then it plans, drives the first arc, looks, learns and plans anew.
    The longest word grows as long as marks are seen where they are expected. Hidden marks move with the
    others; where most are hidden it drives back. Where its own marks are seen elsewhere than before, a
    camera was knocked: the homography between both views of them carries the model over.

    Args:
        cameras: In so many each mark is seen; as many as the environment has, unless given.
    """

    prior_knowledge = frozenset(
        {
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.NOISE,
            PriorKnowledge.CAMERA_MODEL,
            PriorKnowledge.FLOOR,
            PriorKnowledge.WORD_LIMIT,
        }
    )

    def __init__(self, env: gym.Env[Any, Any], cameras: int | None = None, seed: int = 0) -> None:
        super().__init__(env, seed)
        if cameras is None:
            cameras = getattr(getattr(env.unwrapped, "config", None), "cameras", 1)
        self._edges = np.reshape(env.observation_space["achieved_goal"].high, (-1, 2)).astype(float)  # type: ignore[index]
        self.cameras = check_number("cameras", cameras, least=1, whole=True)
        if len(self._edges) % cameras:
            raise ValueError(f"cameras is {cameras}, but {len(self._edges)} points are seen in all")
        self.known = self._unknown()

    @property
    def kind(self) -> str:
        return f"Arcs(cameras={self.cameras})"

    def _unknown(self) -> KnownOfArcs:
        return KnownOfArcs(len(self._edges), self._motors, self.cameras)

    def observed(self, raw: Any) -> DockObservation:
        return DockObservation.of(raw)

    def new_findings(self) -> KnownOfArcs:
        known = self._unknown()
        known.restore(self.known.arrays())
        return known

    def procedure(self, first: Any, findings: KnownOfArcs) -> Procedure:
        """See `ProcedureAgent`: explores where nothing is known, then plans arc by arc."""
        trial = ArcsTrial(first, findings, Planner(self._edges, np.random.default_rng(self.seed)))
        while not trial.now.last:
            ready = findings.looks and findings.model.knows
            yield from trial.drive() if ready else trial.explore()

    def learn_trial(self, findings: KnownOfArcs, last: Any, ended: bool) -> None:
        """See `ProcedureAgent`."""
        findings.model.fit(ArcsTrial.ROUNDS)
        self.known = findings

    def arrays(self) -> dict[str, NDArray[Any]]:
        return self.known.arrays()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.known.restore(arrays)


class ArcsTrial:
    """One trial of `Arcs`.

    Attributes:
        now: What was seen last.
        here: Where marks are then (p, 2), though hidden.

    Args:
        first: What is seen where it begins.
        known: What is known, and becomes so.
        planner: Makes the plans.
    """

    FIRST_WORD, EXPLORE_PX = 0.06, 60.0
    """The first word, and how far such motions are to move images. Choice: a hundred times the noise."""
    LEAST, MOST = 0.01, 0.5
    """Within these, words explore."""
    SHORTER = 0.6
    """Where marks were lost, it explores the other way by this share. Choice."""
    WELL, FAIRLY = 4.0, 10.0
    """Within so many deviations of what is expected, an arc lets longer ones be tried; less than fairly, only
    shorter ones. Choice."""
    GROWTH, CUT, LEAST_TRUST = 1.8, 0.5, 0.05
    """By so much. Choice."""
    SURPRISES = 3
    """So often in a row less than fairly expected, wheels are others than before. Choice."""
    STILL_PX, ROUNDS = 4.0, 10
    """A plan that leaves more, yet moves no mark so far, is worth exploring anew; a fit takes so many rounds.
    Choice."""

    def __init__(self, first: DockObservation, known: KnownOfArcs, planner: Planner) -> None:
        self.now, self.known, self._planner = first, known, planner
        self._rest: Array | None = None
        self._surprises = 0
        self._look()
        self.here = first.points
        if known.looks and first.visible.any():
            shift = (first.points - known.goal)[first.visible].mean(0)
            self.here = np.where(first.visible[:, None], first.points, known.goal + shift)

    def _look(self) -> bool:
        return bool(self.now.shown.all()) and self.known.look(self.now.goal)

    def move(self, words: Array) -> Generator[Array, DockObservation, float | None]:
        """Executes words (m,), and learns from what is then seen.

        Returns:
            So many deviations off what it expected; None where nothing tells, or a camera was knocked.
        """
        words, before, model = np.clip(words, -1, 1), self.now, self.known.model
        here, expected = self.here, model.predict(self.here, words)
        doubt_px = model.doubt_px(here, words)
        self.now = yield words
        self.here = model.corrected(expected, words, self.now.points, self.now.visible)
        seen = before.visible & self.now.visible
        if self._look() or not seen.any():
            return None
        if self.known.looks and self.now.visible.all():
            model.aim(self.now.points, self.known.goal)
        model.learn(DrivenArc(here, words, self.now.points, seen))
        return float((lengths_px(expected - self.now.points) / doubt_px)[seen].max())

    @property
    def lost(self) -> bool:
        """Whether most marks are hidden, or out of the images."""
        return bool(2 * self.now.visible.sum() < len(self.here))

    def explore(self) -> Motions:
        """Each motor alone, then all together and against each other."""
        size, motors = self.FIRST_WORD, len(self.now.registers)
        against = np.where(np.arange(motors) % 2, -1.0, 1.0)
        for way in [*np.eye(motors), np.ones(motors), against]:
            words = size * way
            for _ in range(2):
                before = self.now
                yield from self.move(words)
                if not self.lost:
                    moved = np.abs(self.here - before.points)[before.visible].max(initial=0) / IMAGE_UNIT
                    size *= float(np.clip(self.EXPLORE_PX / max(moved, 1.0), 0.4, 2.5))
                    size = float(np.clip(size, self.LEAST, self.MOST))
                    break
                yield from self.move(-words)
                words = -self.SHORTER * words
        self.known.model.fit(2 * self.ROUNDS)

    def drive(self) -> Motions:
        """The first arc of a plan, no longer than what is trusted; back, where marks are lost."""
        known, model = self.known, self.known.model
        here = self.here
        plan = self._planner.plan(model, model.straight(here), model.straight(known.goal), self._rest)
        arc = plan.words[0]
        arc = arc * min(1.0, known.trust / max(float(np.abs(arc).max()), 1e-9))
        stays = lengths_px(model.predict(here, arc) - here).max() < self.STILL_PX
        if stays and plan.left_px > self.STILL_PX:
            yield from self.explore()
            return
        missed = yield from self.move(arc)
        self._rest = plan.words[1:]
        lost, well, fairly = self.lost, False, True
        if missed is not None:
            well, fairly = missed < self.WELL, missed < self.FAIRLY
            self._surprises = 0 if fairly else self._surprises + 1
        if lost:
            yield from self.move(-arc)
        if lost or missed is None:
            self._rest = None
        known.trust *= self.CUT if lost or not fairly else self.GROWTH if well else 1.0
        known.trust = float(np.clip(known.trust, self.LEAST_TRUST, 1.0))
        if self._surprises >= self.SURPRISES:
            known.model.forget(self.SURPRISES)
            self._surprises = 0
        known.model.fit(self.ROUNDS)
