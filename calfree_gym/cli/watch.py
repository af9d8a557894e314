"""`calfree watch`: what the trackers see, on a page of this machine, in a file, or in LeRobot's viewer."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Condition, Thread

from calfree_gym.cli.drawing import drawn, jpeg, side_by_side
from calfree_gym.cli.robots import INSTALL
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.picture_reach import PictureLook

PAUSE_S = 0.1
PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>calfree watch</title>
<body style="margin:0;background:#222">
<img src="stream" alt="what both cameras see" style="width:100%"></body></html>"""
BOUNDARY = "picture"
Show = Callable[[PictureLook], None]


def watch(standing: StandingRobot, show: Show) -> None:
    """Shows what is seen, again and again, until Ctrl-C.

    Raises:
        ArmError: The robot does not answer.
    """
    with suppress(KeyboardInterrupt):
        while True:
            show(standing.look())
            standing.sleep(PAUSE_S)


class Page:
    """A page on localhost that shows the latest look, and no past ones.

    Args:
        port: Of it; 0: any that is free.

    Raises:
        OSError: The port is taken, or there is no such one.
    """

    def __init__(self, port: int) -> None:
        self._new, self._picture, self._number = Condition(), b"", 0
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path == "/":
                    page._answer(self, "text/html")
                    self.wfile.write(PAGE)
                elif self.path == "/stream":
                    page._answer(self, f"multipart/x-mixed-replace; boundary={BOUNDARY}")
                    with suppress(ConnectionError):
                        page._stream(self)
                else:
                    self.send_error(404)

            def log_message(self, *_: object) -> None:
                """Says nothing."""

        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        except (OSError, OverflowError) as error:
            raise OSError(f"port {port}: {error}; choose another one with --port") from error
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_address[1]}/"
        Thread(target=self._server.serve_forever, daemon=True).start()

    def __call__(self, look: PictureLook) -> None:
        """Shows a look to whoever looks at the page."""
        picture = jpeg(side_by_side(look))
        with self._new:
            self._picture, self._number = picture, self._number + 1
            self._new.notify_all()

    def close(self) -> None:
        """Takes the page away."""
        self._server.shutdown()
        self._server.server_close()

    @staticmethod
    def _answer(handler: BaseHTTPRequestHandler, kind: str) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", kind)
        handler.send_header("Cache-Control", "no-store")
        handler.end_headers()

    def _stream(self, handler: BaseHTTPRequestHandler) -> None:
        shown = 0
        while True:
            with self._new:
                while self._number == shown:
                    self._new.wait()
                picture, shown = self._picture, self._number
            head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            handler.wfile.write(head.encode() + picture + b"\r\n")


def to_file(path: Path) -> Show:
    """Writes each look to a file, in place of the last one."""

    def show(look: PictureLook) -> None:
        half = path.with_name(f"{path.name}.part")
        half.write_bytes(jpeg(side_by_side(look)))
        half.replace(path)

    return show


def to_lerobot(cameras: tuple[str, str]) -> Show:
    """Shows each look where LeRobot shows data.

    Raises:
        ImportError: LeRobot or its viewer is not installed.
    """
    try:
        from lerobot.utils.visualization_utils import init_visualization, log_visualization_data
    except ImportError as error:
        raise ImportError(f"--display_data needs LeRobot ({error}): {INSTALL}") from error
    init_visualization("rerun", session_name="calfree watch")

    def show(look: PictureLook) -> None:
        pictures = {name: drawn(look, camera) for camera, name in enumerate(cameras)}
        log_visualization_data("rerun", observation=pictures)

    return show
