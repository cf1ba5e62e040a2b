"""A browser that tests drive: pages are opened at a size, asked, pointed at and photographed.

Chromium speaks its DevTools protocol over two pipes: JSON objects, each ended by a zero byte.
"""

import base64
import fcntl
import json
import os
import select
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.report.browser import find_browser

OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--remote-debugging-pipe", "--hide-scrollbars"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    "--disable-renderer-backgrounding",
)
PATIENCE = 120.0  # s; a page that takes longer is a failure


class Browser:
    """A running chromium."""

    def __init__(self, folder: str) -> None:
        browser = find_browser()
        assert browser is not None
        down, up = os.pipe(), os.pipe()
        ends = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 20) for fd in (down[0], up[1])]

        def connect() -> None:
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self.process = subprocess.Popen(
            [browser, *OPTIONS, f"--user-data-dir={folder}/profile", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(3, 4, *ends),
            preexec_fn=connect,
        )
        for fd in (down[0], up[1], *ends):
            os.close(fd)
        self.writing, self.reading = down[1], up[0]
        self.number, self.rest = 0, b""
        self.events: list[dict[str, Any]] = []

    def send(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self.number += 1
        call: dict[str, Any] = {"id": self.number, "method": method, "params": parameters}
        if session is not None:
            call["sessionId"] = session
        os.write(self.writing, json.dumps(call).encode() + b"\0")
        end = time.monotonic() + PATIENCE
        while True:
            answer = self.receive(end)
            if answer.get("id") == self.number:
                assert "error" not in answer, (method, answer["error"])
                result: dict[str, Any] = answer["result"]
                return result
            self.events.append(answer)

    def receive(self, end: float) -> dict[str, Any]:
        """Return the next object that the browser sends."""
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.reading], [], [], max(end - time.monotonic(), 0.0))
            assert ready, "the browser does not answer"
            part = os.read(self.reading, 2**20)
            assert part, "the browser ended"
            self.rest += part
        text, _, self.rest = self.rest.partition(b"\0")
        answer: dict[str, Any] = json.loads(text)
        return answer

    def close(self) -> None:
        """End the browser."""
        os.close(self.writing)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.reading)


class Tab:
    """One page in a browser."""

    def __init__(self, browser: Browser, width: int, height: int, scheme: str) -> None:
        self.browser = browser
        target = browser.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = browser.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page", "Network"):
            self.send(f"{domain}.enable")
        self.send("Page.bringToFront")
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
            mobile=width < 600,
        )  # fmt: skip
        still = {"name": "prefers-reduced-motion", "value": "reduce"}
        color = {"name": "prefers-color-scheme", "value": scheme}
        self.send("Emulation.setEmulatedMedia", features=[color, still])

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol for this page."""
        return self.browser.send(method, self.session, **parameters)

    def open(self, page: Path, ready: str = "window.tensegrity?.ready === true") -> None:
        """Open a file, and go on when the expression `ready` is true."""
        self.send("Page.navigate", url=page.as_uri())
        self.wait(ready)

    def ask(self, expression: str) -> Any:
        """Return the value of a JavaScript expression; a promise is awaited."""
        found = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str) -> None:
        """Go on when an expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.ask(expression):
            assert time.monotonic() < end, (
                expression,
                self.ask("document.body.innerText"),
                self.complaints(),
            )
            time.sleep(0.02)

    def frame(self) -> None:
        """Let the page draw two frames."""
        self.ask("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def mouse(self, kind: str, x: float, y: float, *, button: str = "none", wheel: float = 0.0) -> None:
        """Send an event of the mouse: "Pressed", "Moved", "Released" or "Wheel"."""
        held = {"left": 1}.get(button, 0)
        self.send(
            "Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, button=button, buttons=held,
            clickCount=int(kind in ("Pressed", "Released")), deltaX=0, deltaY=wheel,
        )  # fmt: skip

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 8) -> None:
        """Press at one place, move, release at another."""
        self.mouse("Moved", *start)
        self.mouse("Pressed", *start, button="left")
        for k in range(1, steps + 1):
            part = k / steps
            place = [a + part * (b - a) for a, b in zip(start, end, strict=True)]
            self.mouse("Moved", *place, button="left")
        self.mouse("Released", *end, button="left")

    def touch(self, *paths: list[tuple[float, float]]) -> None:
        """Put one finger on the start of each path, move them along, lift them."""
        self.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        for k in range(len(paths[0])):
            points = [{"x": path[k][0], "y": path[k][1], "id": finger} for finger, path in enumerate(paths)]
            kind = "touchMove" if k else "touchStart"
            self.send("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key: str) -> None:
        """Press and release a key."""
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key)

    def photograph(self, path: Path) -> None:
        """Write a picture (.png) of what is visible."""
        path.write_bytes(base64.b64decode(self.send("Page.captureScreenshot", format="png")["data"]))

    def complaints(self) -> list[str]:
        """Return errors and warnings of the console, and uncaught exceptions."""
        self.ask("0")
        found = []
        for event in self._events():
            method, data = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(json.dumps(data["exceptionDetails"]))
            if method == "Runtime.consoleAPICalled" and data["type"] in ("error", "warning", "assert"):
                found.append(json.dumps(data["args"]))
            if method == "Log.entryAdded" and data["entry"]["level"] in ("error", "warning"):
                found.append(data["entry"]["text"])
        return found

    def requests(self) -> list[str]:
        """Return all addresses that the page asked for, other than parts of itself."""
        self.ask("0")
        sent = [event for event in self._events() if event.get("method") == "Network.requestWillBeSent"]
        addresses = [event["params"]["request"]["url"] for event in sent]
        return [address for address in addresses if not address.startswith(("file:", "blob:", "data:"))]

    def _events(self) -> list[dict[str, Any]]:
        return [event for event in self.browser.events if event.get("sessionId") == self.session]


@contextmanager
def running_browser() -> Iterator[Browser]:
    """Start a browser, and end it."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(folder)
        try:
            yield browser
        finally:
            browser.close()
