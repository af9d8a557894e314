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
from calfree_gym.files import whole
from calfree_gym.picture_reach import PictureLook

PAUSE_S = 0.1
PATIENCE_S = 5.0
"""With who asks for the page or looks at it, and does nothing. Choice."""
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
            timeout = PATIENCE_S

            def do_GET(self) -> None:
                if self.headers["Host"] not in page._hosts:  # another site's name may lead here
                    self.send_error(403)
                elif self.path == "/":
                    page._answer(self, "text/html")
                    self.wfile.write(PAGE)
                elif self.path == "/stream":
                    page._answer(self, f"multipart/x-mixed-replace; boundary={BOUNDARY}")
                    with suppress(ConnectionError, TimeoutError):
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
        self._hosts = [f"{name}:{self._server.server_address[1]}" for name in ("127.0.0.1", "localhost")]
        self.address = f"http://{self._hosts[0]}/"
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
        handler.send_header("Cross-Origin-Resource-Policy", "same-origin")
        handler.end_headers()

    def _stream(self, handler: BaseHTTPRequestHandler) -> None:
        """Sends each picture; where none is new, the last one again, which ends where nobody reads it."""
        shown = 0
        while True:
            with self._new:
                if self._number == shown:
                    self._new.wait(PATIENCE_S)
                picture, shown = self._picture, self._number
            head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            handler.wfile.write(head.encode() + picture + b"\r\n")


def to_file(path: Path) -> Show:
    """Writes each look to a file, in place of the last one."""

    def show(look: PictureLook) -> None:
        with whole(path) as file:
            file.write(jpeg(side_by_side(look)))

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
