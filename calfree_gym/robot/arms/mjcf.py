"""Reading an arm's model: MJCF text whose files are found wherever it is read, and the hashes of these."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco

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
        what, folder = str(path), path.parent
    try:
        if what == TEXT:
            return mujoco.MjSpec.from_string(text), what, folder
        return mujoco.MjSpec.from_file(str(source)), what, folder
    except ValueError as error:
        raise ValueError(f"{what} is no MJCF that MuJoCo can read: {error}") from error


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
