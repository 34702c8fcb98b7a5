"""The guard's handlers: Drake's page and its files, and the page's socket."""

import asyncio
import contextlib
import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Final

import msgpack
from tornado.httpclient import AsyncHTTPClient, HTTPError
from tornado.httputil import HTTPServerRequest
from tornado.web import RequestHandler
from tornado.websocket import WebSocketClientConnection, WebSocketClosedError, WebSocketHandler, websocket_connect

from ortilo_drake.views.guarded.panel import BadMessage, Panel

FILES: Final = re.compile(r"|favicon\.ico|cas-v1/[0-9a-f]{64}")  # Drake's page, its icon, the files of its scene
MOST_DRAWN: Final = 2**28  # largest message from Drake, such as a mesh [bytes]
PER_MESSAGE: Final = 1000  # memory of a waiting message in addition to its content [bytes]
ICON: Final = b'<link rel="icon" href="favicon.ico">'
VIEWPORT: Final = b'<meta name="viewport" content="width=device-width">'
READINGS: Final = "readings"  # name of the flight's readings, as JSON
HEADERS: Final = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}


@dataclass
class Rules:
    """The guard's rules, and the pages that are open."""

    drawn_at: str
    """host:port where Drake's Meshcat listens."""
    hosts: tuple[str, ...]
    """host:port of every address at which a user may open the page."""
    token: str
    """first part of the page's path."""
    panel: Panel
    """the page's sliders and buttons."""
    readings: Callable[[], bytes] | None
    """returns the JSON that the page shows as text, lamps and plots beside the view; None shows only the view."""
    refused: Callable[[str], None]
    """called with a line for each refusal."""
    most_pages: int
    """largest number of open pages."""
    most_waiting: int
    """largest amount of data that waits for a page that does not read [bytes]."""
    pages: set["PageSocket"] = field(default_factory=set)
    """the open pages."""

    def refusal(self, request: HTTPServerRequest) -> str | None:
        """Return the reason why a request is refused; None if it is allowed.

        A foreign page sends its own Origin. A page whose name was bound to this machine later (DNS rebinding) sends its
        own Host. Neither knows the token.
        """
        if request.host not in self.hosts:
            return f"Host {request.host!r}: not {self.hosts[0]!r}"
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.host}":
            return f"Origin {origin!r}: another page's"
        token = request.path.split("/")[1] if request.path.startswith("/") else ""
        if not hmac.compare_digest(token.encode("utf-8", "surrogateescape"), self.token.encode()):
            return "an address without the token"
        return None


def what_is_drawn(message: bytes) -> object:
    """Return a key of the thing that a Meshcat message sets; a later message with the same key replaces the message.

    A message that adds instead of setting gets a key that equals no other.
    """
    try:
        told = msgpack.unpackb(message, strict_map_key=False)
        if told["type"] in ("set_object", "set_transform", "set_property", "delete"):
            return told["type"], told["path"], told.get("property")
        if told["type"] == "set_control_value":
            return told["type"], told["name"]
    except (ValueError, TypeError, KeyError, msgpack.UnpackException):
        pass
    return object()


def with_ours(page: bytes, reads: bool) -> bytes:
    """Return Drake's page with the icon's address, and, if `reads` is true, with the readings beside the view.

    Without this address, a browser asks for the icon at the root, without the token.
    """
    head, body = ICON, b""
    if reads:
        css, js = ((files(__package__) / f"beside.{kind}").read_bytes() for kind in ("css", "js"))
        head, body = ICON + VIEWPORT + b"<style>" + css + b"</style>", b"<script>" + js + b"</script>"
    return page.replace(b"</head>", head + b"</head>", 1).replace(b"</body>", body + b"</body>", 1)


class _Guarded(RequestHandler):
    def initialize(self, rules: Rules) -> None:
        self.rules, self._waits = rules, 0
        self._drawn: WebSocketClientConnection | None = None

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        why = self.rules.refusal(self.request)
        if why is not None:
            self.rules.refused(why)
            self.set_status(403)
            self.finish("refused\n")

    def file(self) -> str:
        """Return the name of the requested file of Drake's page."""
        return self.request.path.removeprefix(f"/{self.rules.token}/")


class PageFile(_Guarded):
    """The handler of Drake's page, its icon, its scene's files, and the flight's readings."""

    async def get(self) -> None:
        """Answer with the requested file; 404 if there is no such file."""
        name = self.file()
        if name == READINGS and self.rules.readings is not None:
            self.set_header("Content-Type", "application/json")
            self.finish(self.rules.readings())
            return
        if not FILES.fullmatch(name):
            self.set_status(404)
            self.finish("no such file\n")
            return
        try:
            found = await AsyncHTTPClient().fetch(f"http://{self.rules.drawn_at}/{name}")
        except (HTTPError, OSError):
            self.set_status(502)
            self.finish("Meshcat has gone\n")
            return
        kind = "image/x-icon" if name.endswith("ico") else "text/javascript" if name else "text/html; charset=utf-8"
        self.set_header("Content-Type", kind)
        self.finish(found.body if name else with_ours(found.body, self.rules.readings is not None))


class PageSocket(_Guarded, WebSocketHandler):
    """The socket of an open page: it sends Drake's drawing commands and receives the panel's values."""

    def open(self, *_: str, **__: str) -> None:
        """Begin to forward Drake's drawing commands."""
        if len(self.rules.pages) >= self.rules.most_pages:
            self._end(1013, f"a page beyond {self.rules.most_pages} open ones")
            return
        self.rules.pages.add(self)
        self._left: dict[object, bytes] = {}
        self._sends = asyncio.Event()
        self._tasks = [asyncio.ensure_future(each) for each in (self._bring(), self._send())]

    async def _bring(self) -> None:
        try:
            self._drawn = await websocket_connect(f"ws://{self.rules.drawn_at}/", max_message_size=MOST_DRAWN)
            while self in self.rules.pages and (message := await self._drawn.read_message()) is not None:
                self.bring(message if isinstance(message, bytes) else message.encode())
        except OSError:
            pass
        finally:
            self._let_go()
            self.close(1001)

    def bring(self, message: bytes) -> None:
        """Queue a message for the page; close the page if too much waits for it.

        A page that draws more slowly than the flight gets only the latest state of each object.
        """
        drawn = what_is_drawn(message)
        self._waits += len(message) + PER_MESSAGE
        if drawn in self._left:
            self._waits -= len(self._left.pop(drawn)) + PER_MESSAGE
        self._left[drawn] = message
        if self._waits > self.rules.most_waiting:
            self.rules.refused(f"a page that left {self._waits / 1e6:.1f} MB unread")
            self.drop()
        self._sends.set()

    async def _send(self) -> None:
        """Send the waiting messages, oldest first, each after the page has taken the last one."""
        with contextlib.suppress(WebSocketClosedError):  # the page has gone; on_close handles this
            while self in self.rules.pages:
                while self._left:
                    message = self._left.pop(next(iter(self._left)))
                    await self.write_message(message, binary=True)
                    self._waits -= len(message) + PER_MESSAGE
                self._sends.clear()
                await self._sends.wait()

    def on_message(self, message: str | bytes) -> None:
        """Take a panel value and show it on the other pages; close a page that sends anything else."""
        if self not in self.rules.pages:
            return
        try:
            moved = self.rules.panel.receive(message)
        except BadMessage as error:
            self._end(1008, f"a message: {error}")
            return
        if moved is not None:
            value = self.rules.panel.value(moved)
            told = {"type": "set_control_value", "name": moved, "value": value, "invoke_callback": False}
            for page in self.rules.pages - {self}:
                page.bring(msgpack.packb(told))

    def on_close(self) -> None:
        """Stop forwarding Drake's drawing commands."""
        if self in self.rules.pages:
            self.rules.pages.remove(self)
            self._sends.set()  # so that _send ends
        self._let_go()

    def _let_go(self) -> None:
        """Close the socket to Drake at once; an orderly close could outlast the server's loop."""
        if self._drawn is not None and self._drawn.protocol is not None:
            stream = self._drawn.protocol.stream
            self._drawn.close()
            if stream is not None:
                stream.close()

    def drop(self) -> None:
        """Close the page at once, even if messages wait."""
        self.on_close()
        stream = None if self.ws_connection is None else self.ws_connection.stream
        if stream is not None:
            stream.close()

    def _end(self, code: int, why: str) -> None:
        self.rules.refused(why)
        self.close(code)
        self.on_close()
