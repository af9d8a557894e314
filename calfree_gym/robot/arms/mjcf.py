"""Reading an arm's model: MJCF text whose files are found wherever it is read, and the hashes of these."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco

Source = str | Path | mujoco.MjSpec


def read(source: Source) -> tuple[Any, dict[str, str]]:
    """The spec of a model, with the folders of its assets written out, and the assets' hashes.

    Args:
        source: Path of an MJCF file, MJCF text, or an `MjSpec`.

    Returns:
        The `MjSpec`, compiled, and for each asset file the SHA-256 of its bytes, as hexadecimal digits.

    Raises:
        ValueError: There is no such file, it is no MJCF, or an asset is missing.
    """
    spec, what, folder = _spec(source)
    spec.meshdir = str((folder / spec.meshdir).resolve())
    spec.texturedir = str((folder / spec.texturedir).resolve())
    if spec.assets:
        raise ValueError(
            f"{what} holds assets in memory ({', '.join(sorted(spec.assets))}); write them to files beside "
            "the model, so that they can be found again"
        )
    _name_all(spec)
    assets = {str(file): _digest(file, what) for file in sorted(set(_files(spec)))}
    try:
        spec.compile()
        return spec, assets
    except ValueError as error:
        raise ValueError(f"{what} cannot be compiled by MuJoCo: {error}") from error


def _spec(source: Source) -> tuple[Any, str, Path]:
    """A copy of the spec that may be changed, what errors call it, and the folder of its relative paths."""
    if isinstance(source, mujoco.MjSpec):
        return source.copy(), "the MjSpec", Path(source.modelfiledir or ".")
    text = str(source)
    if text.lstrip().startswith("<"):
        what, folder = "the MJCF text", Path()
    else:
        path = Path(source)
        if not path.is_file():
            raise ValueError(f"{path}: there is no such MJCF file")
        what, folder = str(path), path.parent
    try:
        if what == "the MJCF text":
            return mujoco.MjSpec.from_string(text), what, folder
        return mujoco.MjSpec.from_file(str(source)), what, folder
    except ValueError as error:
        raise ValueError(f"{what} is no MJCF that MuJoCo can read: {error}") from error


def _name_all(spec: Any) -> None:
    """Bodies and joints without a name are called by their place."""
    for kind, elements in (("body", spec.bodies[1:]), ("joint", spec.joints)):
        for i, element in enumerate(elements):
            element.name = element.name or f"{kind}_{i}"


def _files(spec: Any) -> Iterator[Path]:
    """The files that the model's meshes, height fields, skins and textures are in."""
    for folder, elements in (
        (spec.meshdir, (*spec.meshes, *spec.hfields, *spec.skins)),
        (spec.texturedir, spec.textures),
    ):
        for element in elements:
            cubes = [file for file in getattr(element, "cubefiles", ()) if file]
            yield from (Path(folder) / file for file in (element.file, *cubes) if file)


def _digest(file: Path, what: str) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ValueError(
            f"{what} names {file.name}, which cannot be read at {file}: {error.strerror}"
        ) from error
