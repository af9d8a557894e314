"""Writing a film as MP4 and GIF, and its strip as PNG: all are there as a whole, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from PIL import Image as Pictures

from experiments.errors import ConfigError
from experiments.film.pictures import COLOURS, Image, Moment, chosen, frame_strip

MP4, GIF, PNG = "film.mp4", "film.gif", "film.png"
CODEC = "mp4v"
TAKEN = 32
"""The GIF's colours are those of so many of its frames. Choice."""
_OF_SCENES = 255 - len(COLOURS)
"""Colours that are left for scenes; one of 256 stays free, for pixels that do not change."""


class FilmFiles:
    """Writes film.mp4, film.gif and film.png in a folder; used in a `with` block, after which they are there.

    Where the block fails nothing is left. Sizes are in pixels; the GIF has no more frames a second than the
    MP4.
    """

    def __init__(
        self,
        folder: Path,
        width: int,
        height: int,
        frames_per_second: int,
        gif_width: int,
        gif_frames_per_second: int,
    ) -> None:
        self._files = self.mp4, self.gif, self.png = folder / MP4, folder / GIF, folder / PNG
        self.frames = 0
        self._size, self._rate = (width, height), frames_per_second
        self._gif_size = gif_width, round(height * gif_width / width)
        self._gif_rate = gif_frames_per_second
        self._small: list[tuple[Any, int]] = []
        self._moments: list[Moment] = []

    @property
    def seconds(self) -> float:
        """How long the film is."""
        return self.frames / self._rate

    def __enter__(self) -> Self:
        """Begins the MP4."""
        self.mp4.parent.mkdir(parents=True, exist_ok=True)
        self._discard()  # under these names a stranger's folder may have links
        codec = cv2.VideoWriter.fourcc(*CODEC)
        self._writer = cv2.VideoWriter(str(_partial(self.mp4)), codec, float(self._rate), self._size)
        if not self._writer.isOpened():
            self._discard()
            raise ConfigError(
                f"{self.mp4}: OpenCV {cv2.__version__} cannot write it here; is the folder writable, and was "
                f"OpenCV built with the codec {CODEC!r}, as the wheel opencv-python-headless is?"
            )
        return self

    def add(self, frame: Image, times: int) -> None:
        """Shows a frame (height, width, 3) so many times."""
        for _ in range(times):
            self._writer.write(frame[..., ::-1])
        begins, ends = (n * self._gif_rate // self._rate for n in (self.frames - 1, self.frames + times - 1))
        self.frames += times
        if ends > begins:
            small = cv2.resize(frame, self._gif_size, interpolation=cv2.INTER_AREA)
            self._small.append((cv2.imencode(".png", small)[1], ends - begins))

    def keep(self, moment: Moment) -> None:
        """Keeps a moment for the strip."""
        self._moments.append(moment)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finishes all files, or leaves none."""
        try:
            self._writer.release()
            if kind is None:
                self._finish()
        finally:
            self._discard()

    def _finish(self) -> None:
        if not self._moments:
            raise ConfigError(f"{self.mp4}: there is nothing to show")
        written = cv2.VideoCapture(str(_partial(self.mp4))).get(cv2.CAP_PROP_FRAME_COUNT)
        if int(written) != self.frames:
            raise ConfigError(f"{self.mp4}: {written:.0f} of {self.frames} frames were written: a full disk?")
        self._write_gif()
        strip = Pictures.fromarray(frame_strip(chosen(self._moments)))
        strip.save(_partial(self.png), optimize=True)
        for path in self._files:
            _partial(path).replace(path)

    def _write_gif(self) -> None:
        """Frames that last: GIF counts in hundredths of a second."""
        palette = self._palette()
        pictures = (small.quantize(palette=palette, dither=Pictures.Dither.NONE) for small in self._decoded())
        next(pictures).save(
            _partial(self.gif),
            save_all=True,
            append_images=pictures,
            duration=[round(1000 * times / self._gif_rate) for _, times in self._small],
            loop=0,
        )

    def _palette(self) -> Any:
        """A picture that has the colours of the film."""
        taken = list(self._decoded(max(1, len(self._small) // TAKEN)))
        scenes = Pictures.fromarray(np.vstack([np.asarray(each) for each in taken]))
        found = scenes.quantize(_OF_SCENES, Pictures.Quantize.MEDIANCUT).getpalette() or []
        palette = Pictures.new("P", (1, 1))
        palette.putpalette([*(part for colour in COLOURS for part in colour), *found[: 3 * _OF_SCENES]])
        return palette

    def _decoded(self, step: int = 1) -> Iterator[Pictures.Image]:
        for packed, _ in self._small[::step]:
            yield Pictures.fromarray(np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)))

    def _discard(self) -> None:
        for path in self._files:
            _partial(path).unlink(missing_ok=True)


def _partial(path: Path) -> Path:
    """Where a file is until it is whole; its ending tells OpenCV and Pillow what it is."""
    return path.with_name(f".{path.stem}.partial{path.suffix}")
