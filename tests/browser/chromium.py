"""Headless Chromium, driven by the DevTools protocol over Tornado's WebSocket, which comes with distributed."""

import asyncio
import base64
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from tornado.websocket import WebSocketClientConnection, websocket_connect
from waiting import HANGS

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-dev-shm-usage", "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE = HANGS


def chromium() -> str | None:
    """Return the browser's path, None if there is none."""
    return next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )


class Page:
    """A tab, with what it said on its console and asked of the network since it was opened."""

    def __init__(self, socket: WebSocketClientConnection, loop: asyncio.AbstractEventLoop):
        self._socket, self._loop, self._numbers = socket, loop, itertools.count(1)
        self.errors: list[str] = []
        self.requests: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result; events that come meanwhile are noted."""
        number = next(self._numbers)
        self._wait(self._send(json.dumps({"id": number, "method": method, "params": parameters})))
        while True:
            message = json.loads(self._wait(self._receive()) or '{"method": "Inspector.detached"}')
            assert message.get("method") not in ("Inspector.detached", "Inspector.targetCrashed"), (
                "the browser has gone"
            )
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    async def _send(self, text: str) -> None:
        await self._socket.write_message(text)

    async def _receive(self) -> str | bytes | None:
        return await self._socket.read_message()

    def _wait(self, awaitable: Any) -> Any:
        return self._loop.run_until_complete(asyncio.wait_for(awaitable, PATIENCE))

    def _note(self, event: dict[str, Any]) -> None:
        name, about = event.get("method"), event.get("params", {})
        if name == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])
        elif name == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(about["exceptionDetails"])[:500])
        elif name == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.errors.append(json.dumps(about["args"])[:500])
        elif name == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(about["entry"]["text"])

    def run(self, script: str) -> Any:
        """Return the value of a JavaScript expression."""
        done = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def until(self, script: str) -> Any:
        """Return the value of an expression once it is true."""
        end = time.monotonic() + PATIENCE
        while not (value := self.run(script)):
            assert time.monotonic() < end, f"never true: {script}"
            time.sleep(0.05)
        return value

    def open(self, url: str, width: int = 1280, height: int = 900) -> None:
        """Go to an address, in a window of that size."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=url)
        self.until(f"location.href === {json.dumps(url)} && document.readyState === 'complete'")

    def screenshot(self, whole: bool = False) -> bytes:
        """Return a PNG of the window, or of all of the page."""
        return base64.b64decode(self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"])

    def pdf(self) -> bytes:
        """Return the page as it prints."""
        return base64.b64decode(self.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"])


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """Run Chromium with a new profile folder; yield its tab."""
    command = (chromium() or "chromium", *FLAGS, f"--user-data-dir={profile}", "about:blank")
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    loop = asyncio.new_event_loop()
    try:
        port = profile / "DevToolsActivePort"  # Chromium writes there which port it took
        end = time.monotonic() + PATIENCE
        while not (port.exists() and "\n" in port.read_text()):
            assert process.poll() is None, f"chromium ended with code {process.returncode}"
            assert time.monotonic() < end, "chromium did not start"
            time.sleep(0.05)
        with urlopen(f"http://127.0.0.1:{port.read_text().splitlines()[0]}/json/list", timeout=PATIENCE) as answer:
            (tab,) = [found for found in json.load(answer) if found["type"] == "page"]

        async def connect() -> WebSocketClientConnection:
            return await websocket_connect(tab["webSocketDebuggerUrl"], max_message_size=2**28)

        socket = loop.run_until_complete(connect())
        yield Page(socket, loop)

        async def hang_up() -> None:  # in its loop: another test's asyncio.run leaves the thread without one
            socket.close()
            await asyncio.sleep(0.05)

        loop.run_until_complete(hang_up())
    finally:
        process.terminate()
        process.wait(PATIENCE)
        loop.close()
