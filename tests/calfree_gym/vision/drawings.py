"""Drawn frames of three balls, with their true places: made by OpenCV, outside our renderer.

Balls are flat discs, shaded spheres, or such with jagged edges; backgrounds have gradients and textures. The
camera adds exposure with clipping, white balance, blur, motion blur, noise and JPEG.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np

from calfree_gym.vision.marks import MARK_NAMES, Marks
from calfree_gym.vision.tracking.tracker import BallFinder, gripper_point

COLOURS = {"gripper_1": (242, 13, 140), "gripper_2": (13, 13, 242), "object": (13, 242, 13)}
SIZES = [(512, 512), (256, 256), (480, 640)]


@dataclass
class Frame:
    """An image (h, w, 3) with the true place (2,) in px, radius in px and visible share of each ball."""

    image: np.ndarray
    centre: dict = field(default_factory=dict)
    radius: dict = field(default_factory=dict)
    visible: dict = field(default_factory=dict)


class Canvas:
    def __init__(self, background):
        self.picture = background.astype(np.float32)
        self._balls = {}

    def put(self, alpha, colour, at=(0, 0), name=None):
        """Covers a part of the picture by `alpha` (h, w), with a colour (3,) or colours (h, w, 3)."""
        part = (slice(at[1], at[1] + alpha.shape[0]), slice(at[0], at[0] + alpha.shape[1]))
        alpha = alpha.astype(np.float32)
        self.picture[part] += alpha[..., None] * (np.asarray(colour, np.float32) - self.picture[part])
        for each in self._balls.values():
            each[1][part] *= 1 - alpha
        if name:
            left = np.zeros(self.picture.shape[:2], np.float32)
            left[part] = alpha
            self._balls[name] = [float(alpha.sum()), left]

    def ball(self, name, centre, radius, colour, rng, kind="sphere", stretch=1.0):
        """Puts a ball; `centre` in px from the image's corner."""
        h, w = self.picture.shape[:2]
        x0, y0 = np.maximum(np.subtract(centre, 1.5 * radius + 3), 0).astype(int)
        x1, y1 = np.clip(np.add(centre, 1.5 * radius + 4), (x0, y0), (w, h)).astype(int)
        if x1 <= x0 or y1 <= y0:
            return
        fine = 1 if kind == "jagged" else 6
        y, x = (np.mgrid[: (y1 - y0) * fine, : (x1 - x0) * fine] + 0.5) / fine
        away = np.array(centre) - [w / 2, h / 2]
        away = away / max(np.hypot(*away), 1e-9)
        dx, dy = x + x0 - centre[0], y + y0 - centre[1]
        u, v = (dx * away[0] + dy * away[1]) / stretch / radius, (dy * away[0] - dx * away[1]) / radius
        inside = u * u + v * v <= 1
        shade, shine = np.ones_like(u), np.zeros_like(u)
        if kind != "disc":
            shade, shine = self._light(u, v, rng)
        colours = np.asarray(colour) * shade[..., None] + 255 * shine[..., None]
        size = (x1 - x0, y1 - y0)
        weight, sums = (
            cv2.resize(each.astype(np.float32), size, interpolation=cv2.INTER_AREA)
            for each in (inside, colours * inside[..., None])
        )
        self.put(weight, sums / np.maximum(weight, 1e-6)[..., None], (x0, y0), name)

    @staticmethod
    def _light(u, v, rng):
        normal = np.stack([u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0))], -1)
        lamp = rng.normal(size=3)
        lamp[2] = abs(lamp[2])
        lamp /= np.linalg.norm(lamp)
        ambient = rng.uniform(0.25, 0.8)
        cosine = np.maximum(normal @ lamp, 0)
        shade = ambient + (1 - ambient) * rng.uniform(0.3, 1.2) * cosine
        half = lamp + np.array([0, 0, 1])
        shine = np.maximum(normal @ (half / np.linalg.norm(half)), 0) ** rng.uniform(20, 80)
        return shade, rng.choice([0, 0, rng.uniform(0.1, 0.9)]) * shine

    def polygon(self, corners, colour):
        """Puts a filled polygon; corners (n, 2) in px."""
        h, w = self.picture.shape[:2]
        low = np.clip(np.floor(np.min(corners, 0)).astype(int) - 1, 0, [w, h])
        high = np.clip(np.ceil(np.max(corners, 0)).astype(int) + 2, 0, [w, h])
        if (high <= low).any():
            return
        alpha = np.zeros(np.flip(high - low), np.uint8)
        fixed = np.round((np.asarray(corners) - low - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(alpha, [fixed], 255, cv2.LINE_AA, 4)
        self.put(alpha / 255, colour, low)

    def visible(self, name):
        whole, left = self._balls[name]
        return float(left.sum() / max(whole, 1e-9))


def dull(rng):
    largest, saturation = rng.uniform(20, 240), rng.uniform(0, 0.3)
    return largest * (1 - saturation * rng.permutation([0, rng.uniform(), 1]))


def background(rng, h, w):
    """A gradient between two dull colours with texture and dull shapes, (h, w, 3)."""
    y, x = np.mgrid[0 : 1 : 1j * h, 0 : 1 : 1j * w]
    a, b = rng.uniform(-1, 1, 2)
    ramp = np.clip((a * x + b * y + 1) / 2, 0, 1)[..., None]
    canvas = Canvas(dull(rng) * ramp + dull(rng) * (1 - ramp))
    for _ in range(rng.integers(0, 12)):
        middle, size = rng.uniform(0, 1, 2) * [w, h], rng.uniform(0.02, 0.4) * w
        canvas.polygon(middle + size * rng.normal(size=(rng.integers(3, 6), 2)), dull(rng))
    grain = rng.normal(size=[max(2, int(s / rng.uniform(1, 30))) for s in (h, w)])
    texture = cv2.resize(grain, (w, h), interpolation=cv2.INTER_LINEAR)
    return np.clip(canvas.picture * (1 + rng.uniform(0, 0.35) * texture[..., None]), 0, 255)


def camera(picture, rng, white_balance=0.15, jpeg=0.5):
    """What a camera makes of a picture (h, w, 3): blur, motion blur, exposure, noise, JPEG at times."""
    scale = picture.shape[1] / 512
    sigma = rng.uniform(0, 1.5) * scale
    if sigma > 0.2:
        picture = cv2.GaussianBlur(picture, (0, 0), sigma)
    length = rng.uniform(0, 4.0) * scale
    if length > 1:
        picture = _smeared(picture, length, rng.uniform(0, np.pi))
    picture = picture * rng.uniform(1 - white_balance, 1 + white_balance, 3) * np.exp(rng.uniform(-0.7, 0.5))
    picture = picture + rng.uniform(0, 6.0) * rng.normal(size=picture.shape)
    image = np.clip(np.round(picture), 0, 255).astype(np.uint8)
    return through_jpeg(image, int(rng.integers(60, 96))) if rng.uniform() < jpeg else image


def _smeared(picture, length, angle):
    steps = np.linspace(-length / 2, length / 2, 9)
    h, w = picture.shape[:2]
    shifts = [np.array([[1, 0, s * np.cos(angle)], [0, 1, s * np.sin(angle)]]) for s in steps]
    edges = {"borderMode": cv2.BORDER_REPLICATE}
    return np.mean([cv2.warpAffine(picture, shift, (w, h), **edges) for shift in shifts], 0)


def through_jpeg(image, quality):
    """The image (h, w, 3) after one round trip."""
    done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


def cut_out(photograph):
    """As `background`, of a part of a photograph (h, w, 3), at times mirrored."""

    def behind(rng, h, w):
        height, width = photograph.shape[:2]
        part = np.array([h, w]) * rng.uniform(0.4, 1) * min(height / h, width / w)
        tall, wide = part.astype(int)
        y, x = rng.integers(0, height - tall + 1), rng.integers(0, width - wide + 1)
        found = photograph[y : y + tall, x : x + wide][:, :: rng.choice([1, -1])]
        how = cv2.INTER_AREA if tall > h else cv2.INTER_CUBIC
        return cv2.resize(np.ascontiguousarray(found, np.float32), (w, h), interpolation=how).clip(0, 255)

    return behind


def random_frame(rng, size, hide=0.0, occlude=0.0, behind=background):
    """A frame of random balls, (h, w) px in size.

    Of these a share is left out, and a share has something dull before it; behind them is what a function as
    `background` makes.
    """
    h, w = size
    scale = min(h, w) / 512
    canvas, frame = Canvas(behind(rng, h, w)), Frame(image=np.zeros(0))
    unit = np.exp(rng.uniform(np.log(4.5), np.log(26))) * scale
    kind = rng.choice(["disc", "sphere", "jagged"])
    while True:
        places = rng.uniform(0.06, 0.94, (3, 2)) * [w, h]
        way = rng.uniform(-1, 1, 2)
        places[1] = places[0] + way / np.hypot(*way) * rng.uniform(3, 10) * unit
        gaps = [np.hypot(*(places[i] - places[j])) for i in range(3) for j in range(i)]
        if min(gaps) > 2.7 * unit and (np.abs(places[1] / [w, h] - 0.5) < 0.44).all():
            break
    for name, place in zip(MARK_NAMES, places, strict=True):
        radius = unit * np.exp(rng.uniform(-0.15, 0.15))
        eccentric = np.hypot(*(place - [w / 2, h / 2])) / (w / 2)
        stretch = np.sqrt(1 + (eccentric * rng.uniform(0.3, 0.8)) ** 2)
        frame.centre[name], frame.radius[name] = place, radius * np.sqrt(stretch)
        if rng.uniform() < hide:
            frame.visible[name] = 0.0
            continue
        canvas.ball(name, place, radius, COLOURS[name], rng, str(kind), stretch)
        if rng.uniform() < occlude:
            occluder(canvas, place, radius, rng)
    for name in MARK_NAMES:
        frame.visible.setdefault(name, -1.0)
        if frame.visible[name] < 0:
            frame.visible[name] = canvas.visible(name)
    frame.image = camera(canvas.picture, rng)
    return frame


def occluder(canvas, place, radius, rng):
    along = rng.uniform(0, 2 * np.pi)
    d, n = np.array([np.cos(along), np.sin(along)]), np.array([-np.sin(along), np.cos(along)])
    start = rng.uniform(-0.9, 1.0) * radius
    end = start + (4 * radius if rng.uniform() < 0.7 else rng.uniform(0.2, 0.8) * radius)
    corners = [place + s * 4 * radius * d + e * n for s, e in ((-1, start), (1, start), (1, end), (-1, end))]
    canvas.polygon(corners, dull(rng))


def drawn(seed, count, **options):
    return [random_frame(np.random.default_rng([seed, i]), SIZES[i % 3], **options) for i in range(count)]


def compared(frames):
    """How near the tracker comes to true places.

    Returns:
        Visible share and error in px of a 512 image (nan: not found) per ball; the gripper's errors.
    """
    finder, rows, gripper = BallFinder(Marks()), [], []
    for frame in frames:
        finder.reset()
        balls, scale = finder(frame.image), 512 / min(frame.image.shape[:2])
        for name in MARK_NAMES:
            error = np.hypot(*(balls[name].centre - frame.centre[name])) * scale if name in balls else np.nan
            rows.append((frame.visible[name], error))
        if min(frame.visible[name] for name in MARK_NAMES[:2]) > 0.95 and gripper_point(balls) is not None:
            (p, z1), (q, z2) = ((frame.centre[n], 1 / frame.radius[n]) for n in MARK_NAMES[:2])
            gripper.append(np.hypot(*(gripper_point(balls) - (z1 * p + z2 * q) / (z1 + z2))) * scale)
    return np.array(rows), np.array(gripper)
