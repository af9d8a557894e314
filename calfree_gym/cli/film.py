"""A film of a run: one picture a motion, from both cameras, with what the agent noticed."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from calfree_gym.cli.drawing import Image, write
from calfree_gym.cli.recording import Noticed, RecordedReach

SHOWN_MS, LAST_MS = 500, 1500
"""For how long each picture is shown, and the last one of a reach."""
QUALITY = 60
HEAD = 48
PLAIN, MARKED = (235, 235, 235), (255, 160, 0)


def film(reaches: Iterable[RecordedReach], noticed: Iterable[Noticed]) -> bytes:
    """An animated WebP, which OpenCV writes from 4.11 on, and browsers show; empty where there is none.

    A reach in which the agent noticed a change has a frame.
    """
    changes: dict[int, list[str]] = {}
    for each in noticed:
        changes.setdefault(each.reach, []).append(each.what)
    pictures: list[Image] = []
    durations: list[int] = []
    for reach in reaches:
        for frame in reach.frames:
            encoded = np.frombuffer(frame.picture, np.uint8)
            picture = np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB), np.uint8)
            image = np.pad(picture, ((HEAD, 0), (0, 0), (0, 0)))
            write(image, frame.said, (8, 19), PLAIN)
            if marks := changes.get(reach.number):
                write(image, f"in this reach the agent notices a change: {', '.join(marks)}", (8, 40), MARKED)
                cv2.rectangle(image, (0, 0), (image.shape[1] - 1, image.shape[0] - 1), MARKED, 6)
            pictures.append(image)
            durations.append(LAST_MS if frame is reach.frames[-1] else SHOWN_MS)
    if not pictures or not hasattr(cv2, "Animation"):
        return b""
    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(each[..., ::-1]) for each in pictures]
    animation.durations = durations
    return bytes(cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1])
