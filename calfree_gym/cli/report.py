"""The report of a run of reaches: one HTML page that needs no other file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from calfree_gym.cli.recording import FilmFrame, Noticed, RecordedReach
from calfree_gym.files import whole

BAR, GAP, HEIGHT = 28, 12, 160
"""Of the bars, in px."""


def write_report(
    path: Path,
    title: str,
    settings: Mapping[str, object],
    reaches: Sequence[RecordedReach],
    noticed: Sequence[Noticed],
    film: bytes,
    error: str,
) -> None:
    """Writes the page.

    Args:
        path: Of the page.
        title: Heads it.
        settings: What the run was started with.
        reaches: All of them; the last one may have not ended.
        noticed: What the agent believes has changed.
        film: A WebP, or nothing.
        error: Why the run could not go on; empty where it could.
    """
    ended = [each for each in reaches if each.outcome]
    parts = [f"<h1>{escape(title)}</h1>", _list(f"{key}: {value}" for key, value in settings.items())]
    if error:
        parts.append(f'<div class="error"><h2>The run could not go on</h2><p>{escape(error)}</p></div>')
    if ended:
        parts += ["<h2>Motions of each reach</h2>", _bars(ended, noticed), _table(ended)]
    parts += ["<h2>What the agent believes has changed</h2>", _changes(noticed)]
    parts += ["<h2>Film</h2>", _film(film), "<h2>Pictures</h2>"]
    parts += [_pictures(each) for each in reaches if each.frames]
    style = files(__package__).joinpath("report.css").read_text(encoding="utf-8")
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{style}</style>'
    body = "\n".join(parts)
    with whole(path) as file:
        file.write(f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>'.encode())


def _list(lines: object) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"  # type: ignore[attr-defined]


def _bars(ended: Sequence[RecordedReach], noticed: Sequence[Noticed]) -> str:
    """A bar a reach, as an SVG; a line after each reach in which a change was noticed."""
    most = max(each.outcome.motions for each in ended if each.outcome)
    drawn = []
    for i, each in enumerate(ended):
        assert each.outcome is not None
        x, height = 30 + i * (BAR + GAP), HEIGHT * each.outcome.motions / max(most, 1)
        top, colour = 20 + HEIGHT - height, "good" if each.outcome.reached else "bad"
        drawn += [
            f'<rect x="{x}" y="{top:.1f}" width="{BAR}" height="{height:.1f}" style="fill:var(--{colour})"/>',
            f'<text x="{x + BAR / 2}" y="{top - 5:.1f}" text-anchor="middle">{each.outcome.motions}</text>',
            f'<text x="{x + BAR / 2}" y="{HEIGHT + 36}" text-anchor="middle">{each.number}</text>',
        ]
        if any(one.reach == each.number for one in noticed):
            where = f'x="{x - 3}" y="{HEIGHT + 42}" width="{BAR + 6}" height="4"'
            drawn.append(f'<rect {where} style="fill:var(--marked)"/>')
    width = 40 + len(ended) * (BAR + GAP)
    marked = " Orange: a change was noticed." if noticed else ""
    said = f"Green: reached. Red: not.{marked} Test motions count."
    return (
        f'<figure><svg viewBox="0 0 {width} {HEIGHT + 50}" width="{width}" role="img">{"".join(drawn)}</svg>'
        f"<figcaption>{said}</figcaption></figure>"
    )


def _table(ended: Sequence[RecordedReach]) -> str:
    head = ("reach", "reached", "motions", "px of 512, worse camera", "s", "stayed back")
    rows = [
        (
            each.number,
            "yes" if each.outcome.reached else "no",
            each.outcome.motions,
            f"{each.outcome.px:.1f}",
            f"{each.outcome.seconds:.0f}",
            ", ".join(each.outcome.stopped),
        )
        for each in ended
        if each.outcome
    ]
    heads = "".join(f"<th>{each}</th>" for each in head)
    cells = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{heads}</tr>{cells}</table>"


def _changes(noticed: Sequence[Noticed]) -> str:
    if not noticed:
        return "<p>Nothing, or it does not tell.</p>"
    return _list(f"in reach {each.reach}: {each.what}" for each in noticed)


def _film(film: bytes) -> str:
    if not film:
        return "<p>There is none: nothing was seen, or OpenCV is older than 4.11.</p>"
    return (
        f'<img src="data:image/webp;base64,{b64encode(film).decode()}" alt="all looks, one after the other">'
        "<p>One picture a motion. The frame marks reaches in which a change was noticed.</p>"
    )


def _pictures(reach: RecordedReach) -> str:
    first, last = reach.frames[0], reach.frames[-1]
    shown = _figure(first) + (_figure(last) if last is not first else "")
    return f"<h3>Reach {reach.number}</h3>{shown}"


def _figure(frame: FilmFrame) -> str:
    picture = b64encode(frame.picture).decode()
    said = escape(frame.said)
    return (
        f'<figure><img src="data:image/jpeg;base64,{picture}" alt="{said}">'
        f"<figcaption>{said}</figcaption></figure>"
    )
