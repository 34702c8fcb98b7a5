"""A small server in front of Drake's Meshcat, because Meshcat itself obeys anyone who reaches its port.

Any web page that is open in a browser of this machine can reach a port of this machine. Meshcat checks neither the
sender nor the content of a message. So Meshcat listens where no web page finds it, and the user's browser talks to
this server instead.
"""

import asyncio
import contextlib
import secrets
import socket
import sys
from collections.abc import Callable
from threading import Event, Thread
from typing import Final, Self
from urllib.parse import urlsplit

from pydrake.geometry import Meshcat
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import Application

from ortilo_drake.model.input_error import InputError, one_line
from ortilo_drake.views.guarded.handlers import PageFile, PageSocket, Rules
from ortilo_drake.views.guarded.panel import LARGEST, Panel
from ortilo_drake.world.scenery.meshcat_room import make_meshcat

HOST: Final = "127.0.0.1"
MOST_PAGES: Final = 8
MOST_WAITING: Final = 32_000_000  # most unread data of one page [bytes]; a scene begins with 3 MB
PATIENCE: Final = 10.0  # longest silence of a client [s]
MOST_LINES: Final = 20  # most lines about refusals; a refused client tries again and again


def hidden_meshcat() -> Meshcat:
    """Return a Meshcat on a port and, on Linux, at a loopback address that cannot be guessed.

    Linux has 16 million loopback addresses. Elsewhere there is one, and only the port is random.
    """
    if sys.platform != "linux":
        return make_meshcat(0, HOST)
    address = f"127.{secrets.randbelow(256)}.{secrets.randbelow(256)}.{2 + secrets.randbelow(253)}"
    return make_meshcat(0, address)


class _Upgrades(Matcher):
    def match(self, request: HTTPServerRequest) -> dict[str, object] | None:
        return {} if request.headers.get("Upgrade", "").lower() == "websocket" else None


class Guard:
    """A server, in a thread, of a Meshcat's page at an address with a random token, while the context lasts.

    `meshcat` comes from hidden_meshcat; `panel` has the page's sliders and buttons; port None takes a free port.
    `readings` returns the JSON that the page shows beside the view, None shows only the view. `refused` is called with
    a line for each new refusal. Both are called in the server's thread. `most_pages` limits the open pages, and
    `most_waiting` the bytes that wait for a page that does not read. InputError if the port is taken.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        panel: Panel,
        port: int | None = None,
        readings: Callable[[], bytes] | None = None,
        refused: Callable[[str], None] = lambda line: None,
        most_pages: int = MOST_PAGES,
        most_waiting: int = MOST_WAITING,
    ):
        try:
            self._socket = socket.create_server((HOST, port or 0), backlog=128)
        except OSError as error:
            raise InputError(f"--port {port}: {error.strerror or error}") from None
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        token, self._said, self._say = secrets.token_urlsafe(16), set[str](), refused
        self.url = f"http://{HOST}:{self.port}/{token}/"
        self._rules = Rules(
            urlsplit(meshcat.web_url()).netloc,
            (f"{HOST}:{self.port}", f"localhost:{self.port}"),
            token, panel, readings, self._refused, most_pages, most_waiting,
        )  # fmt: skip
        self._serves, self._thread = Event(), Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._serves.wait()
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop may already have ended
            self._loop.call_soon_threadsafe(self._ends.set)
        self._thread.join(1.0)

    def _refused(self, line: str) -> None:
        line = one_line(line)
        if line not in self._said and len(self._said) < MOST_LINES:
            self._said.add(line)
            self._say(line)

    async def _serve(self) -> None:
        self._loop, self._ends = asyncio.get_running_loop(), asyncio.Event()
        answers = {"rules": self._rules}
        application = Application(
            [Rule(_Upgrades(), PageSocket, answers), (r".*", PageFile, answers)],
            websocket_max_message_size=LARGEST,
            log_function=lambda handler: None,  # _refused reports instead
        )
        server = HTTPServer(
            application,
            idle_connection_timeout=PATIENCE, body_timeout=PATIENCE,
            max_header_size=16_384, max_body_size=0,
        )  # fmt: skip
        server.add_socket(self._socket)
        self._serves.set()
        await self._ends.wait()
        server.stop()
        for page in list(self._rules.pages):
            page.drop()
        await asyncio.wait(
            {asyncio.ensure_future(server.close_all_connections())} | asyncio.all_tasks() - {asyncio.current_task()},
            timeout=0.3,
        )
