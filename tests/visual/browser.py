"""A page in headless Chromium, driven through its own pipe, and every error it reports."""

import base64
import io
import json
import os
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from PIL import Image

from tests.visual.headless import Pixels

PATIENCE_S = 300.0  # a software renderer on a busy machine; a quiet one needs half a minute

# Rerun's page asks the internet for fonts and a list of examples: there is an internet, and it has
# nothing
NOTHING: Final[dict[str, Any]] = {
    "responseCode": 200,
    "responseHeaders": [
        {"name": f"Access-Control-Allow-{what}", "value": "*"} for what in ("Origin", "Headers")
    ],
    "body": base64.b64encode(b"[]").decode(),
}


class NotReadyError(Exception):
    """The browser cannot do that, or not yet: between two pages there is none to look at."""


class Browser:
    """One page. Its protocol is JSON, a zero byte after each message, through two pipes."""

    def __init__(self, program: str, profile: Path, size_px: tuple[int, int] = (1200, 800)) -> None:
        commands, self._to = os.pipe()
        self._from, answers = os.pipe()
        flags = (
            "--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--no-first-run",
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
            f"--user-data-dir={profile}", f"--window-size={size_px[0]},{size_px[1]}",
        )  # fmt: skip
        # Chromium reads its commands from 3 and writes its answers to 4
        script = f'exec "$@" 3<&{commands} 4>&{answers}'
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", program, *flags, "about:blank"],
            pass_fds=(commands, answers), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(commands)
        os.close(answers)
        self._waiting = b""
        self._number = 0
        self._session = ""
        self._errors: list[str] = []
        (page,) = [
            target
            for target in self._call("Target.getTargets")["targetInfos"]
            if target["type"] == "page"
        ]
        attached = self._call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")
        self._call("Fetch.enable", patterns=[{"urlPattern": "https://*"}])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)

    def open(self, address: str) -> None:
        """Go to an address."""
        self._call("Page.navigate", url=address)

    def picture(self) -> Pixels:
        """The page as it is, (H, W, 3) RGB."""
        shot = self._call("Page.captureScreenshot", format="png")["data"]
        image = Image.open(io.BytesIO(base64.b64decode(shot)))
        return np.asarray(image.convert("RGB"))

    def wait_for(self, enough: Callable[[Pixels], bool]) -> None:
        """Wait until the page looks so."""
        until = time.monotonic() + PATIENCE_S
        while True:
            with suppress(NotReadyError):
                if enough(self.picture()):
                    return
            assert time.monotonic() < until, f"the page never shows it; {self._errors}"
            time.sleep(1.0)

    def errors(self) -> list[str]:
        """What the console got as an error, and exceptions that nobody caught."""
        self._call("Runtime.evaluate", expression="0")  # so that all before it has been heard
        return self._errors

    def _send(self, method: str, **params: Any) -> int:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        return self._number

    def _call(self, method: str, **params: Any) -> Any:
        number = self._send(method, **params)
        while True:
            heard = self._next()
            if heard.get("id") == number:
                if "error" in heard:
                    raise NotReadyError(heard["error"])
                return heard["result"]
            self._note(heard)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._waiting:
            data = os.read(self._from, 1 << 20)
            assert data, "the browser ended"
            self._waiting += data
        message, _, self._waiting = self._waiting.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        return found

    def _note(self, heard: dict[str, Any]) -> None:
        params = heard.get("params", {})
        if heard.get("method") == "Runtime.exceptionThrown":
            self._errors.append(str(params["exceptionDetails"]))
        elif heard.get("method") == "Runtime.consoleAPICalled" and params["type"] == "error":
            self._errors.append(" ".join(str(a.get("value", a)) for a in params["args"]))
        elif heard.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self._errors.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
        elif heard.get("method") == "Fetch.requestPaused":
            self._send("Fetch.fulfillRequest", requestId=params["requestId"], **NOTHING)
