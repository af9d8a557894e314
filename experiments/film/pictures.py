"""A film's pictures: the scene and both camera images, what is written on them, a strip of moments, files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from calfree_gym.engine.frames import GRIPPER_COLOUR, OBJECT_COLOUR, beside
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.vision.image_formation import ImageFormation
from experiments.errors import ConfigError

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

DARK, LIGHT = (30, 30, 34), (240, 240, 240)
ALARM, SUCCESS, FAILURE = (222, 80, 16), (40, 170, 105), (140, 140, 146)
GOOD_NEWS = (120, 225, 140)
SEEN = ("rings: seen", LIGHT)
"""Under the caption, right of what the colours mean."""
EXPECTED = ("crosses: expected", LIGHT)
"""Likewise, of agents that expect something."""
MOST_BARS = 10
"""Of so many trials, the last ones, bars are shown."""
FEWEST_MOTIONS, MOST_MOTIONS = 6, 14
"""Of the highest bar: those of more are not higher, and of fewer not as high."""

COLOURS = (
    *(DARK, LIGHT, ALARM, SUCCESS, FAILURE, GOOD_NEWS, GRIPPER_COLOUR, OBJECT_COLOUR),
    *((255, 255, 255), (0, 0, 0)),
)
"""All that is drawn and written, but for the scene."""


class Trial(NamedTuple):
    """A bar: motions so far, whether it was a success (None: it lasts), whether the world was changed."""

    motions: int = 0
    success: bool | None = None
    knocked: bool = False


class ScreenWords(NamedTuple):
    """What a picture says.

    Attributes:
        marks: What is marked in magenta, and what in green.
        trials: All so far, also those that were not shown.
        expected: Whether the agent has expected anything so far.
    """

    caption: str
    good: bool = False
    announced: str = ""
    unit: str = "trial"
    marks: tuple[str, str] = ("gripper", "object")
    trials: tuple[Trial, ...] = ()
    expected: bool = False


class Lettering:
    """Writes on pictures of one width, and on a band below, under a scene that is narrower; all in pixels."""

    def __init__(self, width: int, scene: int, band: int) -> None:
        self._width, self._scene, self._band = width, scene, band
        self._edge = round(0.18 * band)
        self._font, self._small, self._tiny = font(0.23 * band), font(0.18 * band), font(0.15 * band)

    def write(self, picture: Image, words: ScreenWords) -> Image:
        """The picture (height, width, 3) with what is written, (height + band, width, 3)."""
        height = len(picture)
        canvas = Pictures.new("RGB", (self._width, height + self._band), DARK)
        canvas.paste(Pictures.fromarray(picture), (0, 0))
        draw = ImageDraw.Draw(canvas)
        if words.announced:
            self._announce(draw, words.announced)
        self._below(draw, height, words)
        if words.trials:
            self._bars(draw, height, words)
        return np.asarray(canvas)

    def _announce(self, draw: ImageDraw.ImageDraw, text: str) -> None:
        high = round(0.5 * self._band)
        draw.rectangle((0, 0, self._scene, high), ALARM)
        fits = fitting(text, self._font, self._scene - 2 * self._edge)
        draw.text((self._scene // 2, high // 2), text, (255, 255, 255), fits, anchor="mm")

    def _below(self, draw: ImageDraw.ImageDraw, height: int, words: ScreenWords) -> None:
        """The caption, and under it the legend."""
        x, colour = float(self._edge), GOOD_NEWS if words.good else LIGHT
        fits = fitting(words.caption, self._font, self._scene - 2 * self._edge)
        draw.text((x, height + 0.34 * self._band), words.caption, colour, fits, anchor="lm")
        marks = zip(words.marks, (GRIPPER_COLOUR, OBJECT_COLOUR), strict=True)
        for text, colour in (*marks, SEEN, *[EXPECTED] * words.expected):
            draw.text((x, height + 0.72 * self._band), text, colour, self._small, anchor="lm")
            x += self._small.getlength(text + "   ")

    def _bars(self, draw: ImageDraw.ImageDraw, height: int, words: ScreenWords) -> None:
        """Motions of each trial, as bars; a line stands where the world was changed."""
        edge, left = self._edge, float(self._scene)
        ground, tallest = height + self._band - edge / 2, 0.38 * self._band
        draw.text((left, height + edge / 2), f"motions in each {words.unit}", LIGHT, self._small, anchor="lt")
        step = (self._width - left - edge) / MOST_BARS
        shown = words.trials[-MOST_BARS:]
        highest = min(max(FEWEST_MOTIONS, *(trial.motions for trial in shown)), MOST_MOTIONS)
        for trial in shown:
            bar = ground - tallest * min(1.0, trial.motions / highest)
            if trial.knocked:
                x = left - 0.15 * step
                draw.line((x, ground - 1.3 * tallest, x, ground), ALARM, max(2, self._band // 30))
            draw.rectangle((left, min(bar, ground - 2), left + 0.7 * step, ground), _COLOURS[trial.success])
            middle = left + 0.35 * step, bar - edge / 6
            draw.text(middle, f"{trial.motions}", LIGHT, self._tiny, anchor="mb")
            left += step


_COLOURS: dict[bool | None, Colour] = {None: LIGHT, True: SUCCESS, False: FAILURE}


def font(size: float) -> ImageFont.FreeTypeFont:
    """Pillow's own font, so many pixels high."""
    found = ImageFont.load_default(size)
    assert isinstance(found, ImageFont.FreeTypeFont), "Pillow has one of any size where it has FreeType"
    return found


def fitting(text: str, usual: ImageFont.FreeTypeFont, width: float) -> ImageFont.FreeTypeFont:
    """The font, or a smaller one where text would be wider than `width` pixels."""
    return font(usual.size * min(1.0, width / max(1.0, usual.getlength(text))))


_CROSS = 11.0
"""Half a cross, in pixels of 512."""
_RING = 0.045
"""Radius of the ring around a camera that is changed, as a share of the scene's height."""
_TINT = 0.45
"""So much of a flashing image is the colour of the alarm."""


class Markings(NamedTuple):
    """What is marked in the images.

    Attributes:
        points: Where k points were seen last in c cameras (k, c, 2), in image units.
        seen: Which of them are seen now (k, c).
        target: Around which the task is done (t, c, 2).
        predicted: Where gripper left, right, object left, right are expected (4, 2), NaN where they are not;
            or None.
    """

    points: Array
    seen: Flags
    target: Array
    predicted: Array | None = None

    def lingering(self, predicted: Array | None) -> Markings:
        """While the arm moves: nothing is seen, and all stays where it was seen last."""
        return Markings(self.points, np.zeros_like(self.seen), self.target, predicted)


class Alarm(NamedTuple):
    """What has just happened to a camera.

    Attributes:
        camera: Its name; empty, if to none more than to others. Its image has a border.
        now: Whether it happens now: in the scene the camera is ringed.
        flash: Whether its image flashes.
    """

    camera: str = ""
    now: bool = False
    flash: bool = False


NO_ALARM = Alarm()


class Screen:
    """Draws one robot, whose environment is unwrapped, in pictures so wide and (even) so high.

    With `sensors`, camera images have the light, the blur, exposure and noise by which agents see.
    """

    def __init__(self, env: Any, width: int, height: int, sensors: bool) -> None:
        self._arms = env.arms
        self._frame = env.frame_of(env.arms, width, height, sensors)
        self._sensors = ImageFormation(height // 2) if sensors else None
        self._font, self._stroke = font(height / 28), max(1, height // 300)

    def draw(self, configuration: Array | None, marks: Markings | None, alarm: Alarm = NO_ALARM) -> Image:
        """A picture (height, width, 3): of all that moves (q,) where it is to be, or as it is now."""
        scene, *images = self._frame.views(0, configuration)
        world = self._arms.world(0)
        for camera, name in enumerate(self._arms.robot.cameras):
            image = images[camera]
            if self._sensors is not None:
                image = self._sensors.image(image, world, camera, np.zeros(2))
            if marks is not None:
                self._frame.mark(image, camera, marks.points, marks.seen, marks.target)
                if marks.predicted is not None:
                    draw_crosses(image, marks.predicted[camera::2])
            if name == alarm.camera:
                image = _alarmed(image, alarm.flash)
                if alarm.now:
                    place = np.round(self._frame.camera_in_scene(camera)).astype(int).tolist()
                    radius, width = round(_RING * len(scene)), max(2, len(scene) // 120)
                    cv2.circle(scene, place, radius, ALARM, width, cv2.LINE_AA)
            images[camera] = self._named(image, name)
        return beside(scene, images)

    def _named(self, image: Image, name: str) -> Image:
        picture = Pictures.fromarray(image)
        edge = round(self._font.size / 2)
        ImageDraw.Draw(picture).text(
            (edge, edge), name, LIGHT, self._font, stroke_width=self._stroke, stroke_fill=DARK
        )
        return np.asarray(picture)

    def close(self) -> None:
        """Frees the GL context."""
        self._frame.close()


def _alarmed(image: Image, flash: bool) -> Image:
    """An image of a camera that is changed."""
    if flash:
        image = (image + _TINT * (np.array(ALARM) - image)).astype(np.uint8)
    cv2.rectangle(image, (0, 0), (len(image) - 1,) * 2, ALARM, max(2, len(image) // 40))
    return image


def draw_crosses(image: Image, points: Array) -> None:
    """Draws crosses on an image at gripper and object (2, 2), in image units, but where they are NaN."""
    size = len(image)
    half = max(2, round(_CROSS * size / IMAGE_SIZE))
    for point, colour in zip(points, (GRIPPER_COLOUR, OBJECT_COLOUR), strict=True):
        if not np.isfinite(point).all() or np.abs(point).max() > 1:
            continue
        x, y = np.round((point + 1) * size / 2 - 0.5).astype(int).tolist()
        for shade, thickness in (((255, 255, 255), 4), (colour, 2)):
            cv2.line(image, (x - half, y), (x + half, y), shade, thickness, cv2.LINE_AA)
            cv2.line(image, (x, y - half), (x, y + half), shade, thickness, cv2.LINE_AA)


MOST = 5
"""Moments in a strip."""
FEWEST = 4
"""Where there are fewer turns, looks are shown beside them."""
WIDTH = 400
"""Of a moment, in pixels."""
_GAP, _BELOW = 12, 44
"""Between moments, and for words below them, in pixels."""


class Moment(NamedTuple):
    """What may be shown: a picture `WIDTH` wide, and what is said of it.

    A turn is where a trial ended, or the world was changed; else the agent just looks.
    """

    picture: Image
    words: str
    turn: bool = False
    change: bool = False


def moment(picture: Image, words: str, turn: bool = False, change: bool = False) -> Moment:
    """A moment of a picture of any size."""
    size = WIDTH, round(len(picture) * WIDTH / picture.shape[1])
    return Moment(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)), words, turn, change)


def chosen(moments: Sequence[Moment]) -> list[Moment]:
    """At most `MOST`: from the turn before the first change on; without a change, evenly spaced."""
    turns = [each for each in moments if each.turn]
    shown = turns if len(turns) >= FEWEST else list(moments)
    change = next((place for place, each in enumerate(shown) if each.change), None)
    if change is not None:
        begin = max(0, min(change - 1, len(shown) - MOST))
        return shown[begin : begin + MOST]
    places = np.linspace(0, len(shown) - 1, min(MOST, len(shown))).round().astype(int)
    return [shown[place] for place in places]


def frame_strip(moments: Sequence[Moment]) -> Image:
    """Moments of one size side by side (height, width, 3), on white."""
    if not moments:
        raise ValueError("a strip of no moments")
    height, step = len(moments[0].picture), WIDTH + _GAP
    strip = Pictures.new("RGB", (step * len(moments) - _GAP, height + _BELOW), "white")
    draw, usual = ImageDraw.Draw(strip), font(0.6 * _BELOW)
    for place, each in enumerate(moments):
        left = place * step
        strip.paste(Pictures.fromarray(each.picture), (left, 0))
        middle = left + WIDTH // 2, height + _BELOW // 2
        draw.text(middle, each.words, DARK, fitting(each.words, usual, WIDTH), anchor="mm")
    return np.asarray(strip)


# -- Files: MP4, GIF and PNG are there as a whole, or not at all

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
        ends = np.rint(100 * np.cumsum([0, *(times for _, times in self._small)]) / self._gif_rate)
        next(pictures).save(
            _partial(self.gif),
            save_all=True,
            append_images=pictures,
            duration=[10 * int(hundredths) for hundredths in np.diff(ends)],
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
