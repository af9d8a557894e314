"""MJCF files of arms, read whole and compiled; and what bodies, joints and motors in them are for."""

from __future__ import annotations

import graphlib
import hashlib
import html
import itertools
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.geometry import Array
from calfree_gym.robot.arms.chain import BALL, FREE, HINGE, SLIDE, path_to

TEXT = "the MJCF text"
"""What errors call a model that was given as text."""
Source = str | Path | Any
"""A path, MJCF text, or an `mujoco.MjSpec`, whose type is not declared."""
_KINDS = {
    "meshes": ("mesh", "meshdir"),
    "hfields": ("hfield", "meshdir"),
    "skins": ("skin", "meshdir"),
    "textures": ("tex", "texturedir"),
}
"""What has files: what a compiled model calls it, and which folder of its compiler the files are in."""
_TAKES_FROM_OTHERS = re.compile(r"<(include|model|flexcomp)\b")
"""Elements whose files become part of the model's text."""
_MAY_TAKE = re.compile(r"<\s*(include|model|flexcomp)\b", re.IGNORECASE)
"""The same in any spelling that MuJoCo reads."""
_FILE = re.compile(r"""\bfile\s*=\s*(?=(["'])([^\0]{1,4096}?)\1)""")
"""What names a file, also in what looks like a comment: in a quote it would be none."""


def read(source: Source) -> tuple[str, dict[str, str]]:
    """The MJCF text of a model, with the places of its assets written out, and the assets' hashes.

    MuJoCo writes numbers with six digits. So text whose places are written out, and which takes nothing from
    other models, stays as it is: it would drift each time.

    Args:
        source: Path of an MJCF file, MJCF text, or an `MjSpec`.

    Returns:
        The text, and for each asset file the SHA-256 of its bytes, as hexadecimal digits.

    Raises:
        ValueError: There is no such file, it is no MJCF, or an asset is missing.
    """
    spec, what, folder = _spec(source)
    if spec.assets:
        raise ValueError(
            f"{what} holds assets in memory ({', '.join(sorted(spec.assets))}); write them to files beside "
            "the model, so that they can be found again"
        )
    written_out = not spec.strippath and all(os.path.isabs(path) for _, path in _files(spec))
    if what == TEXT and written_out and not _TAKES_FROM_OTHERS.search(str(source)):
        return str(source), _digests(spec, what)
    spec.meshdir, spec.texturedir = (
        str((folder / each).resolve()) for each in (spec.meshdir, spec.texturedir)
    )
    _keep_all(spec)
    try:
        _write_out(spec)
        spec.compile()
        text = spec.to_xml()
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{what}, or a file that it includes, is not UTF-8: {error}; save it as that"
        ) from error
    except ValueError as error:
        if missing := re.search(r"Error opening file '(.*)'", str(error)):
            raise _unreadable(spec, what, missing[1]) from error
        raise ValueError(f"{what} cannot be compiled by MuJoCo: {error}") from error
    return text, _digests(mujoco.MjSpec.from_string(text), what)


def compiled(text: str) -> tuple[Any, mujoco.MjModel]:
    """The spec and the model of MJCF text; bodies and joints without a name are called by their place.

    Raises:
        ValueError: It cannot be compiled.
    """
    _check_circles(TEXT, text, Path())
    _check_it_ends(TEXT, text)
    spec = mujoco.MjSpec.from_string(text)
    _keep_all(spec)
    for kind, elements in (("body", spec.bodies[1:]), ("joint", spec.joints)):
        taken = {element.name for element in elements}
        for i, element in enumerate(elements):
            if not element.name:
                free = (f"{kind}_{i}" + "_" * times for times in itertools.count())
                element.name = next(name for name in free if name not in taken)
                taken.add(element.name)
    try:
        return spec, spec.compile()
    except ValueError as error:
        raise ValueError(f"{TEXT} cannot be compiled by MuJoCo: {error}") from error


def _keep_all(spec: Any) -> None:
    """Keeps geoms that touch nothing, as marks do, and bodies without a joint: URDF drops both by default."""
    spec.compiler.discardvisual = spec.compiler.fusestatic = False


def _spec(source: Source) -> tuple[Any, str, Path]:
    """A copy of the spec that may be changed, what errors call it, and the folder of its relative paths."""
    if isinstance(source, mujoco.MjSpec):
        return source.copy(), "the MjSpec", Path(source.modelfiledir or ".")
    if not isinstance(source, str | Path):
        raise ValueError(f"model is {source!r}; it must be a path, MJCF text, or an mujoco.MjSpec")
    text = str(source)
    if text.lstrip().startswith("<"):
        what, folder = TEXT, Path()
    else:
        path = Path(source)
        if not path.is_file():
            raise ValueError(f"{path}: there is no such MJCF file")
        what, folder, text = str(path), path.parent, path.read_text(errors="replace")
    _check_circles(what, text, folder)
    _check_it_ends(what, text)
    try:
        if what == TEXT:
            return mujoco.MjSpec.from_string(text), what, folder
        return mujoco.MjSpec.from_file(str(source)), what, folder
    except ValueError as error:
        raise ValueError(f"{what} is no MJCF that MuJoCo can read: {error}") from error


def _check_circles(what: str, text: str, folder: Path) -> None:
    """Raises ValueError where a model takes itself from a file, by whatever way round: MuJoCo would crash."""
    graph: dict[str, list[str]] = {}
    waiting = [(os.path.realpath(what), text)]
    while waiting:
        file, text = waiting.pop()
        graph[file] = []
        for _, name in _FILE.findall(text) if _TAKES_FROM_OTHERS.search(text) else ():
            places = (os.path.join(each, html.unescape(name)) for each in (os.path.dirname(file), folder))
            graph[file] += [os.path.realpath(place) for place in places if os.path.isfile(place)][:1]
        waiting += [(each, Path(each).read_text(errors="replace")) for each in {*graph[file]} - graph.keys()]
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        raise ValueError(f"{what} is made of itself: {' names '.join(error.args[1][::-1])}") from None


_READS = (
    "import sys, mujoco; path, text = sys.argv[1], sys.stdin.read();"
    "mujoco.MjSpec.from_file(path) if path else mujoco.MjSpec.from_string(text)"
)


def _check_it_ends(what: str, text: str) -> None:
    """Raises ValueError where MuJoCo would crash all the same: a process of its own tries it.

    Only where a model may take something from others: else MuJoCo says what is wrong.
    """
    if not _MAY_TAKE.search(text):
        return
    command = [sys.executable, "-c", _READS, "" if what == TEXT else what]
    tried = subprocess.run(command, input=text, capture_output=True, text=True, errors="replace")
    if tried.returncode < 0:
        raise ValueError(f"{what} crashes MuJoCo, as a model does that is made of itself")


def _files(spec: Any) -> Iterator[tuple[Any, str]]:
    """Element and path of each file; the paths of attached elements begin where their model is."""
    for kind, (_, folder) in _KINDS.items():
        for element in getattr(spec, kind):
            for file in [element.file] if element.file else getattr(element, "cubefiles", ()):
                if file:
                    file = os.path.basename(file) if spec.strippath else file
                    inside = "" if ":/" in file else getattr(element.compiler, folder)
                    yield element, os.path.normpath(os.path.join(inside, file))


def _write_out(spec: Any) -> None:
    """Writes out the paths of files that are not where the spec's own folders say, as MuJoCo finds them."""
    model = spec.compile()

    def found(kind: str, element: Any) -> str:
        start = getattr(model, f"{_KINDS[kind][0]}_pathadr")[element.id]
        return os.path.abspath(os.fsdecode(model.paths[start:].split(b"\0", 1)[0]))

    for kind, (_, folder) in _KINDS.items():
        for element in getattr(spec, kind):
            own = os.path.join(getattr(spec, folder), element.file)
            if element.file and found(kind, element) != os.path.normpath(own):
                element.file = found(kind, element)
    for face in range(6):  # a model tells one path of a texture, its file's: each face takes that place
        cubes = [texture for texture in spec.textures if not texture.file and texture.cubefiles[face]]
        for texture in cubes:
            texture.file, texture.gridsize[:] = texture.cubefiles[face], 1
        model = spec.compile() if cubes else model
        for texture in cubes:
            texture.cubefiles[face], texture.file = found("textures", texture), ""
    spec.strippath = False


def _digests(spec: Any, what: str) -> dict[str, str]:
    """SHA-256 of each file of a spec whose paths are written out."""
    digests = {}
    for _, path in _files(spec):
        try:
            digests[path] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
        except OSError as error:
            raise _unreadable(spec, what, path) from error
    return digests


def _unreadable(spec: Any, what: str, path: str) -> ValueError:
    """The error that names a file and the elements that it is for."""
    path = os.path.normpath(path)
    users = [
        f"{type(element).__name__[3:].lower()} {element.name!r}"
        for element, each in _files(spec)
        if each == path
    ]
    where = path if os.path.isabs(path) else f"{path}, seen from the model that names it"
    return ValueError(
        f"{what} names {os.path.basename(path)}, which cannot be read at {where} ({', '.join(users)})"
    )


FEWEST, MOST = 3, 7
"""Motors of an arm."""
TURN = 2 * np.pi
"""So much (rad) of a hinge is used at most: beyond, the arm is where it was before."""


class Parts:
    """The parts of a model.

    Attributes:
        gripper: ("site" or "body", name) of the gripper point.
        holder: Id of the body to which the gripper point belongs.
        at: Where in its frame (3,) the point is, in m.
        base: Name of the body where the chain starts.
        motors: Ids of the motors' joints, m of them.
        links: Ids of the bodies behind the base whose distance from the body before is not zero.

    Args:
        model: The model, in which bodies and joints have names.
        gripper, motors, base: As in `Arm`.

    Raises:
        ValueError: As in `Arm`.
    """

    def __init__(
        self, model: mujoco.MjModel, gripper: str, motors: Sequence[str] | None, base: str | None
    ) -> None:
        self._model = model
        self.joints = [model.joint(i).name for i in range(model.njnt)]
        self.bodies = [model.body(i).name for i in range(model.nbody)]
        self.gripper, self.holder, self.at = self._gripper(gripper)
        way = path_to(model, self.holder)
        self.base = self._base(base, [self.bodies[body] for body in way])
        behind = way[[self.bodies[body] for body in way].index(self.base) :]
        self.motors = self._motors(motors, behind)
        self.links = [body for body in behind[1:] if np.linalg.norm(model.body_pos[body]) > 0]
        self._refuse_loops()

    @property
    def turning(self) -> list[str]:
        """Names of all hinges and slides."""
        kinds = self._model.jnt_type
        return [name for joint, name in enumerate(self.joints) if kinds[joint] in (HINGE, SLIDE)]

    def range(self, joint: int) -> tuple[float, float]:
        """Lowest and highest position of a motor's joint, in rad or m; infinite of a hinge without limits."""
        model, name = self._model, self.joints[joint]
        if model.jnt_limited[joint]:
            low, high = (float(stop) for stop in model.jnt_range[joint])
            if low < high:
                return low, high
            raise ValueError(f"the motor {name!r} ranges from {low:g} to {high:g}; it cannot move")
        if model.jnt_type[joint] == SLIDE:
            raise ValueError(
                f"the motor {name!r} slides without limits; give its joint a range, or choose other motors "
                "by motors= or base="
            )
        return -np.inf, np.inf

    def stops(self, joint: int, home: float | None = None) -> tuple[float, float]:
        """The same, of what is used of it: of a hinge that goes round more than once, one turn in its range.

        That is as far to both sides of `home` as the range allows. By default home is the middle of the
        range, and zero where there is no range.
        """
        low, high = self.range(joint)
        if self._model.jnt_type[joint] == SLIDE or high - low <= TURN:
            return low, high
        if home is None:
            home = (low + high) / 2 if np.isfinite(low) else 0.0
        low = float(np.clip(home - TURN / 2, low, high - TURN))
        return low, low + TURN

    def home(self, home: str | Mapping[str, float] | None) -> Array:
        """Positions of all joints (nq,) at a keyframe, or by name; within their ranges where not given."""
        model = self._model
        if isinstance(home, str):
            keys = [model.key(i).name or f"key_{i}" for i in range(model.nkey)]
            if home not in keys:
                raise ValueError(
                    f"the arm has no keyframe {home!r}{near_misses(home, keys)}; it has {_list(keys)}"
                )
            qpos = model.key_qpos[keys.index(home)].copy()
        else:
            qpos = self._within_ranges(model.qpos0)
            for name, value in (home or {}).items():
                if name not in self.turning:
                    raise ValueError(
                        f"home names {name!r}{near_misses(name, self.turning)}; the arm's hinges and slides "
                        f"are {_list(self.turning)}"
                    )
                qpos[model.joint(name).qposadr[0]] = value
        told = self.motors if isinstance(home, str) else [self.joints.index(name) for name in home or ()]
        for joint in (joint for joint in told if model.jnt_limited[joint]):
            name, value, (low, high) = self.joints[joint], qpos[model.jnt_qposadr[joint]], self.range(joint)
            if not low <= value <= high:
                unit = f"rad ({math.degrees(low):g} to {math.degrees(high):g} degrees)"
                if model.jnt_type[joint] == SLIDE:
                    unit = "m"
                raise ValueError(f"home has {name!r} at {value:g}; its range is {low:g} to {high:g} {unit}")
        return qpos

    def _gripper(self, name: str) -> tuple[tuple[str, str], int, Array]:
        model, bodies = self._model, self.bodies[1:]
        sites = [model.site(i).name for i in range(model.nsite)]
        if name and name in sites:
            site = model.site(name).id
            return ("site", name), int(model.site_bodyid[site]), model.site_pos[site].copy()
        if name in bodies:
            return ("body", name), model.body(name).id, np.zeros(3)
        sites = [site for site in sites if site]
        raise ValueError(
            f"the arm has no site or body {name!r}{near_misses(name, [*sites, *bodies])} for a gripper; its "
            f"sites: {_list(sites)}; its bodies: {_list(bodies)}"
        )

    def _base(self, base: str | None, way: list[str]) -> str:
        gripper = self.gripper[1]
        if not way:
            raise ValueError(f"the gripper {gripper!r} is fixed in the room; nothing moves it")
        if base is not None and base not in way:
            raise ValueError(
                f"base is {base!r}{near_misses(base, way)}; the bodies on the way to the gripper {gripper!r} "
                f"are {', '.join(way)}"
            )
        return base or way[0]

    def _motors(self, motors: Sequence[str] | None, behind: list[int]) -> list[int]:
        model = self._model
        chain = [joint for joint in range(model.njnt) if model.jnt_bodyid[joint] in behind]
        movable = {self.joints[j]: j for j in chain if model.jnt_type[j] in (HINGE, SLIDE)}
        if motors is None:
            found = list(movable.values())
        elif len(set(motors)) != len(motors):
            raise ValueError(f"motors is {motors!r}; it must be a list of different joints' names")
        else:
            found = [self._motor(name, movable, chain) for name in motors]
        if not FEWEST <= len(found) <= MOST:
            names = _list([self.joints[joint] for joint in found])
            raise ValueError(
                f"the arm has {len(found)} motors, {names}; it must have {FEWEST} to {MOST}. motors= chooses "
                f"among {_list(list(movable))}; the chain starts at base={self.base!r} and ends where "
                f"gripper={self.gripper[1]!r} is, at the body {self.bodies[self.holder]!r}"
            )
        return found

    def _motor(self, name: str, movable: Mapping[str, int], chain: list[int]) -> int:
        if name in movable:
            return movable[name]
        allowed = f"allowed: {_list(list(movable))}"
        if name not in self.joints:
            raise ValueError(f"the arm has no joint {name!r}{near_misses(name, movable)}; {allowed}")
        joint = self.joints.index(name)
        if joint in chain:
            kind = {FREE: "free", BALL: "ball"}[int(self._model.jnt_type[joint])]
            raise ValueError(
                f"the motor {name!r} is a {kind} joint; a motor is a hinge or a slide; {allowed}"
            )
        raise ValueError(
            f"the motor {name!r} is not between the base {self.base!r} and the gripper "
            f"{self.gripper[1]!r}; {allowed}"
        )

    def _within_ranges(self, qpos: Array) -> Array:
        model, within = self._model, qpos.copy()
        for joint in np.flatnonzero(model.jnt_limited & np.isin(model.jnt_type, (HINGE, SLIDE))):
            at = model.jnt_qposadr[joint]
            within[at] = np.clip(within[at], *model.jnt_range[joint])
        return within

    def _refuse_loops(self) -> None:
        """Raises where the model ties a motor to anything else: then other joints would move with it."""
        model = self._model
        for equality in np.flatnonzero(model.eq_active0):
            if tied := self._tied_by(int(equality)):
                name = model.equality(equality).name or int(equality)
                raise ValueError(
                    f"the model's equality {name!r} ties the motors {_list(tied)} to other parts, which "
                    "would have to move with them; only open chains of motors can be simulated"
                )

    def _tied_by(self, equality: int) -> list[str]:
        """Names of the motors that an equality holds; one to a mocap body is of no account."""
        model, kind = self._model, mujoco.mjtEq(self._model.eq_type[equality])
        ends = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        if kind == mujoco.mjtEq.mjEQ_TENDON:
            coupled = [joint for tendon in ends if tendon >= 0 for joint in self._coupled_by(tendon)]
            return [self.joints[joint] for joint in self.motors if joint in coupled]
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            return [self.joints[joint] for joint in self.motors if joint in ends]
        if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            return []
        if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
            ends = int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]])
        if (model.body_mocapid[list(ends)] >= 0).any():
            return []
        between = set(path_to(model, ends[0])) ^ set(path_to(model, ends[1]))
        return [self.joints[joint] for joint in self.motors if int(model.jnt_bodyid[joint]) in between]

    def _coupled_by(self, tendon: int) -> list[int]:
        """Ids of the joints of a fixed tendon."""
        model = self._model
        wraps = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        return [int(model.wrap_objid[i]) for i in wraps if model.wrap_type[i] == mujoco.mjtWrap.mjWRAP_JOINT]


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
