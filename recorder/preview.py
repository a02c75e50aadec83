"""A page on loopback with both views, their histograms and the last reading."""

import json
from collections.abc import Iterator
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread
from typing import Final, Self

import cv2
import numpy as np

from recorder.cameras import Shot
from recorder.capture import Recorder
from recorder.errors import PomologError
from recorder.exposure import half_size
from recorder.optics import to_pixels
from recorder.records import SIDES, Side
from recorder.rig import Rig
from recorder.status_line import status_line

QUALITY: Final = 70  # 1.4 ms a picture
USUAL_RANGE_M: Final = 1.5  # where the crosshair lies before the first reading
CROSS_PX: Final = 14

PAGE: Final = """<!doctype html><meta charset="utf-8"><title>pomolog</title>
<style>body{background:#111;color:#ddd;font:16px system-ui;margin:1em}
.views{display:flex;gap:1em;flex-wrap:wrap}figure{margin:0}img{width:640px;max-width:45vw}
canvas{width:640px;max-width:45vw;height:64px;display:block}#warn{color:#fb4}</style>
<div class="views"><figure><img id="left" alt="left"><canvas id="hleft" width="320" height="64">
</canvas></figure><figure><img id="right" alt="right"><canvas id="hright" width="320" height="64">
</canvas></figure></div><p id="line"></p><p id="warn"></p><p id="reading"></p><p id="messages"></p>
<script>
const $ = id => document.getElementById(id);
function bars(id, counts) {
  const c = $(id), g = c.getContext("2d"), top = Math.max(1, ...counts);
  g.clearRect(0, 0, 320, 64);
  counts.forEach((n, i) => {
    g.fillStyle = i < 1 || i > 30 ? "#f66" : "#6c6";
    g.fillRect(i * 10, 64 - 60 * n / top, 9, 60 * n / top);
  });
}
async function tick() {
  try {
    const s = await (await fetch("status.json")).json();
    $("line").textContent = s.line; $("warn").textContent = s.warnings.join(" · ");
    $("reading").textContent = s.reading; $("messages").textContent = s.messages.join(" · ");
    for (const side of ["left", "right"]) {
      if (s.histograms[side]) bars("h" + side, s.histograms[side]);
      $(side).src = side + ".jpg?" + Date.now();
    }
  } catch (e) { $("warn").textContent = "the recorder does not answer"; }
  setTimeout(tick, 500);
}
tick();
</script>
"""


class Preview:
    """Serves the page while it is entered.

    Args:
        recorder: whose pictures.
        port: on 127.0.0.1; 0 chooses a free one.

    Raises:
        PomologError: the port is taken.
    """

    def __init__(self, recorder: Recorder, port: int) -> None:
        pictures = _Pictures(recorder)
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, pictures))
        except OSError as error:
            raise PomologError(
                f"no preview on port {port}: {error.strerror}; choose another --preview-port"
            ) from None
        self._thread = Thread(target=self._server.serve_forever, name="preview", daemon=True)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.server_port}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Pictures:
    """The newest pictures as JPEG, each made at most once however many look."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder
        self._made: dict[Side, tuple[Shot, bytes]] = {}
        self._lock = Lock()

    def jpeg(self, side: Side) -> bytes | None:
        shot = self.recorder.latest.get(side)
        if shot is None:
            return None
        with self._lock:
            made = self._made.get(side)
            if made is None or made[0] is not shot:
                made = self._made[side] = (shot, self._draw(side, shot))
            return made[1]

    def _draw(self, side: Side, shot: Shot) -> bytes:
        picture = np.ascontiguousarray(half_size(shot))
        reading = self.recorder.last_reading
        range_m = reading.range_m if reading and reading.range_m else USUAL_RANGE_M
        place = crosshair_px(self.recorder.plan.rig, side, range_m)
        if place is not None:
            centre = (round(place[0] / 2), round(place[1] / 2))
            cv2.drawMarker(picture, centre, (255, 255, 255), cv2.MARKER_CROSS, 2 * CROSS_PX, 3)
            cv2.drawMarker(picture, centre, (0, 0, 0), cv2.MARKER_CROSS, 2 * CROSS_PX, 1)
        done, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        assert done
        return jpeg.tobytes()

    def status(self) -> bytes:
        recorder = self.recorder
        status, reading = recorder.status(), recorder.last_reading
        return json.dumps({
            "line": status_line(status),
            "warnings": status.warnings,
            "reading": f"last reading {reading.range_m:.3f} m" if reading else "no reading yet",
            "messages": recorder.messages,
            "histograms": {s: e.histogram.tolist() for s, e in recorder.exposures.items()},
        }).encode()  # fmt: skip


def crosshair_px(rig: Rig, side: Side, range_m: float) -> tuple[float, float] | None:
    """Where the rangefinder's beam meets something at that range, in recorded pixels."""
    beam = rig.rangefinder
    if beam is None:
        return None
    point = beam.origin_m + range_m * beam.direction
    if side == "right":
        point = rig.rotation @ point + rig.translation_m
    if point[2] <= 0:
        return None
    x_px, y_px = to_pixels(rig.camera(side), point[None])[0].tolist()
    return x_px, y_px


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def __init__(self, pictures: _Pictures, *arguments: object) -> None:
        self._pictures = pictures
        super().__init__(*arguments)  # type: ignore[arg-type]  # as the server passes them

    def do_GET(self) -> None:
        """Answer a request from this computer; a page elsewhere cannot make a browser ask."""
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        path = self.path.split("?", 1)[0]
        if host not in ("127.0.0.1", "localhost"):
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"only from this computer")
        elif path == "/":
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", PAGE.encode())
        elif path == "/status.json":
            self._answer(HTTPStatus.OK, "application/json", self._pictures.status())
        else:
            jpeg = next(self._jpegs(path), None)
            if jpeg is None:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here")
            else:
                self._answer(HTTPStatus.OK, "image/jpeg", jpeg)

    def _jpegs(self, path: str) -> Iterator[bytes]:
        for side in SIDES:
            if path == f"/{side}.jpg" and (jpeg := self._pictures.jpeg(side)) is not None:
                yield jpeg

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing: the terminal has a status line."""
