"""Reading an arm's model: MJCF text whose files are found wherever it is read, and the hashes of these."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco

TEXT = "the MJCF text"
"""What errors call a model that was given as text."""
Source = str | Path | Any
"""A path, MJCF text, or an `mujoco.MjSpec`, whose type is not declared."""


def read(source: Source) -> tuple[str, dict[str, str]]:
    """The MJCF text of a model, with the folders of its assets written out, and the assets' hashes.

    MuJoCo writes numbers with six digits. So text whose folders are written out, and which includes no file,
    stays as it is: it would drift each time.

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
    meshes, textures = ((folder / each).resolve() for each in (spec.meshdir, spec.texturedir))
    files = sorted(set(_files(spec, meshes, textures)))
    assets = {str(file): _digest(file, what) for file in files}
    written_out = (str(meshes), str(textures)) == (spec.meshdir, spec.texturedir)
    if what == TEXT and (written_out or not files) and "<include" not in str(source):
        return str(source), assets
    spec.meshdir, spec.texturedir = str(meshes), str(textures)
    _keep_all(spec)
    try:
        spec.compile()
        return spec.to_xml(), assets
    except ValueError as error:
        raise ValueError(f"{what} cannot be compiled by MuJoCo: {error}") from error


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


def _files(spec: Any, meshes: Path, textures: Path) -> Iterator[Path]:
    """The files that the model's meshes, height fields, skins and textures are in."""
    for folder, elements in (
        (meshes, (*spec.meshes, *spec.hfields, *spec.skins)),
        (textures, spec.textures),
    ):
        for element in elements:
            cubes = [file for file in getattr(element, "cubefiles", ()) if file]
            yield from ((folder / file).resolve() for file in (element.file, *cubes) if file)


def _digest(file: Path, what: str) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ValueError(
            f"{what} names {file.name}, which cannot be read at {file}: {error.strerror}"
        ) from error
