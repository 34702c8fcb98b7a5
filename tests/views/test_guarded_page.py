"""The guard before Meshcat: who comes in, what is taken of what they say, and what it costs when they do not read."""

import asyncio
import itertools
import math
import socket
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection
from threading import Thread
from typing import Any
from urllib.parse import quote, urlsplit
from urllib.request import urlopen

import msgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, WebSocketClosedError, websocket_connect
from waiting import HANGS, wait_for

from ortilo_drake.model.input_error import InputError
from ortilo_drake.views.guarded.guard import Guard, hidden_meshcat
from ortilo_drake.views.guarded.panel import LARGEST, BadMessage, Panel

CLICK = msgpack.packb({"type": "button", "name": "go"})
ARRAY = b"\xdd\xff\xff\xff\xff"  # begins one of 2^32 - 1
ELSEWHERE = "http://elsewhere.example"


def slid(value: object, name: str = "push") -> bytes:
    return bytes(msgpack.packb({"type": "slider", "name": name, "value": value}))


def a_panel() -> Panel:
    panel = Panel()
    panel.add_slider("push", -2.0, 2.0, 0.5)
    panel.add_button("go")
    return panel


OPENED: list[WebSocketClientConnection] = []


class Guarded:
    """A guarded Meshcat, its panel, and the lines that it said."""

    def __init__(self, **limits: Any) -> None:
        self.meshcat, self.panel, self.lines = hidden_meshcat(), a_panel(), list[str]()
        self.guard = Guard(self.meshcat, self.panel, refused=self.lines.append, **limits)
        self.host, self.token = urlsplit(self.guard.url).netloc, self.guard.url.split("/")[3]

    async def connect(self) -> WebSocketClientConnection:
        url = self.guard.url.replace("http:", "ws:")
        request = HTTPRequest(url, headers={"Origin": f"http://{self.host}"})
        page = await websocket_connect(request, max_message_size=2**28)
        OPENED.append(page)
        return page


@contextmanager
def guarded(**limits: Any) -> Iterator[Guarded]:
    it = Guarded(**limits)
    try:
        with it.guard:
            yield it
    finally:
        del it.meshcat  # here, because it ends the process if a collector frees it in another thread


@pytest.fixture(scope="module")
def page() -> Iterator[Guarded]:
    with guarded() as it:
        yield it


@pytest.fixture(autouse=True)
def _said_nothing(page: Guarded) -> None:
    page.lines.clear()
    page.guard._said.clear()


def soon(wait: Coroutine[Any, Any, Any]) -> Any:
    """Return what comes of it, once its pages' sockets are closed."""

    async def and_close() -> Any:
        try:
            return await wait
        finally:
            for page in OPENED:
                if page.protocol is not None:
                    stream = page.protocol.stream
                    page.close()
                    stream.close()
            OPENED.clear()

    return asyncio.run(asyncio.wait_for(and_close(), HANGS))


async def closed(page: WebSocketClientConnection) -> int | None:
    """Read until the guard closes; return its code."""
    while await page.read_message() is not None:
        pass
    return page.close_code


async def until(look: Callable[[], object]) -> None:
    """Wait in this thread, which alone may talk to its Meshcat."""
    while not look():
        await asyncio.sleep(0.01)


async def say(it: Guarded, *messages: bytes | str) -> int | None:
    page = await it.connect()
    with suppress(WebSocketClosedError):  # the first message may have closed it already
        for message in messages:
            await page.write_message(message, binary=isinstance(message, bytes))
    return await closed(page)


def status(page: Guarded, path: str, **headers: str) -> int:
    asked = HTTPConnection("127.0.0.1", page.guard.port, timeout=HANGS)
    asked.request("GET", path, headers=headers)
    with asked.getresponse() as answer:
        answer.read()
        asked.close()
        return answer.status


HANDSHAKE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
}


def test_drakes_own_port_is_at_an_address_of_its_own(page: Guarded) -> None:
    other = hidden_meshcat()
    hosts = {urlsplit(meshcat.web_url()).hostname for meshcat in (page.meshcat, other)}
    assert len(hosts) == 2
    for host in hosts:
        assert str(host).startswith("127.")
        with pytest.raises(ConnectionError):
            socket.create_connection(("127.0.0.1", page.meshcat.port()), HANGS)


def test_who_has_the_address_sees_drakes_page_and_what_it_is_made_of(page: Guarded) -> None:
    with urlopen(page.guard.url, timeout=HANGS) as answer:
        html = answer.read().decode()
        assert answer.headers["Referrer-Policy"] == "no-referrer"
    script = html.split('src="')[1].split('"')[0]
    with urlopen(page.guard.url + script, timeout=HANGS) as answer:
        assert b"MeshCat" in answer.read()
    assert '<link rel="icon" href="favicon.ico">' in html
    assert [status(page, f"/{page.token}/{name}") for name in ("favicon.ico", "download", "readings")] == [
        200,
        404,
        404,
    ]
    assert page.lines == []


def test_readings_are_shown_to_who_has_the_address() -> None:
    with guarded(readings=lambda: b'{"time": 1.5}') as it:
        with urlopen(it.guard.url + "readings", timeout=HANGS) as answer:
            assert answer.read() == b'{"time": 1.5}'
        with urlopen(it.guard.url, timeout=HANGS) as answer:
            assert b'fetch("readings"' in answer.read()
        assert status(it, "/readings") == 403


def test_what_drake_draws_arrives_and_counts_as_an_open_page(page: Guarded) -> None:
    async def read_until(path: str) -> None:
        browser = await page.connect()
        while path.encode() not in (await browser.read_message() or b""):
            pass
        assert page.meshcat.GetNumActiveConnections() == 1

    page.meshcat.SetProperty("/drawn/before", "visible", True)
    soon(read_until("/drawn/before"))
    wait_for(lambda: page.meshcat.GetNumActiveConnections() == 0, "the page's end")


@pytest.mark.parametrize("asks", [{}, HANDSHAKE], ids=["page", "socket"])
@pytest.mark.parametrize(
    ("path", "headers", "line"),
    [
        ("/{}/", {"Origin": ELSEWHERE}, f"Origin '{ELSEWHERE}': another page's"),
        ("/{}/", {"Origin": "null"}, "Origin 'null': another page's"),
        ("/{}/", {"Host": "elsewhere.example", "Origin": "http://elsewhere.example"}, "Host 'elsewhere.example': not"),
        ("/{}/", {"Host": "elsewhere.example"}, "Host 'elsewhere.example': not"),  # a name bound anew to this machine
        ("/wrong/", {}, "an address without the token"),
        ("/{}x/", {}, "an address without the token"),
        ("/", {}, "an address without the token"),
        ("/\u00ff/", {}, "an address without the token"),
    ],
)
def test_whoever_comes_from_elsewhere_is_refused_with_a_line(
    page: Guarded, path: str, headers: dict[str, str], line: str, asks: dict[str, str]
) -> None:
    assert status(page, quote(path.format(page.token)), **headers, **asks) == 403
    (said,) = page.lines
    assert said.startswith(line)
    assert page.meshcat.GetNumActiveConnections() == 0


def test_clicks_and_sliders_are_taken_and_shown_on_the_other_pages(page: Guarded) -> None:
    clicks = page.panel.clicks("go")

    async def slide() -> None:
        one, other = await page.connect(), await page.connect()
        for browser in (one, other):
            await browser.read_message()  # it is open
        for message in (CLICK, slid(1.5), CLICK):
            await one.write_message(message, binary=True)
        while (told := msgpack.unpackb(await other.read_message() or b""))["type"] != "set_control_value":
            pass
        assert (told["name"], told["value"], told["invoke_callback"]) == ("push", 1.5, False)

    soon(slide())
    assert page.panel.value("push") == 1.5
    wait_for(lambda: page.panel.clicks("go") == clicks + 2, "the second click")


BAD = {
    "malformed": b"\xc1\xff\xff",
    "cut off": CLICK[:-1],
    "and more": CLICK + CLICK,
    "an array of 2^32 - 1": ARRAY,
    "deep": b"\x91" * 3000,
    "no map": msgpack.packb([1, 2]),
    "text": '{"type": "button", "name": "go"}',
    "no type": msgpack.packb({"name": "go"}),
    "another's button": msgpack.packb({"type": "button", "name": "format the disk"}),
    "a slider as a button": msgpack.packb({"type": "button", "name": "push"}),
    "a list for a name": msgpack.packb({"type": "slider", "name": ["push"], "value": 1}),
    "nan": slid(math.nan),
    "inf": slid(-math.inf),
    "yes": slid(True),
    "no number": slid("1"),
    "nothing": b"",
}


@pytest.mark.parametrize("message", BAD.values(), ids=BAD)
def test_what_no_page_sends_is_refused_in_a_line(message: bytes | str) -> None:
    panel = a_panel()
    with pytest.raises(BadMessage) as error:
        panel.receive(message)
    assert len(str(error.value)) < 150
    assert (panel.value("push"), panel.clicks("go")) == (0.5, 0)


@given(st.binary(max_size=60))
@example(b"\xd6\xff\x00\x00\x00\x00")  # a timestamp
@example(b"\x81\x91\x01\x01")  # a list as a key
def test_no_bytes_raise_anything_else(message: bytes) -> None:
    try:
        a_panel().receive(message)
    except BadMessage:
        return


@given(st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**63), 2**64 - 1)))
def test_a_slider_stays_in_its_range(value: float) -> None:
    panel = a_panel()
    assert panel.receive(slid(value)) == "push"
    assert panel.value("push") == min(max(value, -2.0), 2.0)


def test_what_drakes_page_sends_by_itself_changes_nothing() -> None:
    panel = a_panel()
    camera = {"type": "camera_pose", "camera_pose": [math.nan] * 16, "is_perspective": True}
    pad = {"index": 0, "button_values": [0.0] * 17, "axes": [0.5] * 4}
    for message in (camera, {"type": "gamepad", "name": "", "gamepad": pad}):
        assert panel.receive(msgpack.packb(message)) is None
    assert (panel.value("push"), panel.clicks("go")) == (0.5, 0)


@pytest.mark.parametrize("message", [ARRAY, slid(math.nan), BAD["malformed"], BAD["text"]])
def test_who_sends_it_is_closed_and_drake_draws_on(page: Guarded, message: bytes | str) -> None:
    clicks = page.panel.clicks("go")
    assert soon(say(page, message, CLICK)) == 1008
    assert page.panel.clicks("go") == clicks
    (line,) = page.lines
    assert line.startswith("a message: ")
    page.meshcat.SetProperty("/still/there", "visible", True)
    assert soon(say(page, CLICK, message)) == 1008
    assert page.panel.clicks("go") == clicks + 1


def test_a_message_that_is_too_long_closes_too(page: Guarded) -> None:
    assert soon(say(page, b"\x00" * (LARGEST + 1))) == 1009


def test_many_clicks_cost_the_reader_nothing() -> None:
    panel = a_panel()
    for _ in range(50_000):
        panel.receive(CLICK)
    assert panel.clicks("go") == 50_000


def test_a_page_that_does_not_read_is_closed_and_the_others_stay() -> None:
    with guarded(most_waiting=300_000) as it:

        async def read() -> None:
            deaf, reads = await it.connect(), await it.connect()
            deaf.protocol.stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # type: ignore[union-attr]
            for name in map(str, itertools.count()):
                it.meshcat.SetProperty(f"/big/{name}", "color", [0.5] * 10_000)
                while told := await reads.read_message():  # so that it has at most this one to read, on any machine
                    if str(msgpack.unpackb(told, strict_map_key=False).get("path")).endswith(f"/big/{name}"):  # type: ignore[arg-type]
                        break
                assert told is not None, "the page that reads was closed"
                if it.lines:
                    break

        soon(read())
        (line,) = it.lines
        assert line.startswith("a page that left 0.")


@pytest.mark.long
def test_a_page_that_draws_slower_than_the_flight_gets_how_things_are_and_not_how_they_were() -> None:
    with guarded(most_waiting=300_000) as it:

        async def read() -> tuple[int, object]:
            slow = await it.connect()
            for i in range(1000):
                it.meshcat.SetProperty("/big", "color", [float(i)] * 10_000)
                await asyncio.sleep(0.001)
            got = 0
            while message := await slow.read_message():
                told = msgpack.unpackb(message, strict_map_key=False)  # type: ignore[arg-type]
                if str(told.get("path")).endswith("/big"):
                    got += 1
                    if told["value"][0] == 999.0:
                        break
            return got, it.lines

        got, lines = soon(read())
        assert lines == []
        assert 1 <= got < 500


def test_one_page_more_than_may_be_open_is_closed() -> None:
    with guarded(most_pages=2) as it:

        async def three() -> int | None:
            pages = [await it.connect() for _ in range(2)]
            code = await closed(await it.connect())
            await until(lambda: it.meshcat.GetNumActiveConnections() == len(pages))
            return code

        assert soon(three()) == 1013
        assert it.lines == ["a page beyond 2 open ones"]
        wait_for(lambda: it.meshcat.GetNumActiveConnections() == 0, "the pages' end")
        assert soon(say(it, ARRAY)) == 1008


def test_it_ends_with_pages_open_and_frees_its_port() -> None:
    with guarded() as it:
        asked = f"GET /{it.token}/ HTTP/1.1\r\n".encode()
        with socket.create_connection(("127.0.0.1", it.guard.port), HANGS) as silent:
            silent.sendall(asked)  # and says no more
            deaf = Thread(target=lambda: soon(say(it)))
            deaf.start()
            wait_for(it.meshcat.GetNumActiveConnections, "the page")
            it.guard.__exit__()
            deaf.join(HANGS)
    assert not it.guard._thread.is_alive()
    with pytest.raises(ConnectionError):
        socket.create_connection(("127.0.0.1", it.guard.port), HANGS)


def test_a_port_that_is_taken_is_refused_in_a_line(page: Guarded) -> None:
    with pytest.raises(InputError, match=rf"--port {page.guard.port}: Address"):
        Guard(page.meshcat, Panel(), page.guard.port)


def test_refusals_are_said_once_each_and_not_without_end(page: Guarded) -> None:
    for i in range(100):
        page.guard._refused(f"no \x1b[31m {i}")
        page.guard._refused(f"no \x1b[31m {i}")
    assert 10 <= len(page.lines) == len(set(page.lines)) < 30
    assert all(line.isprintable() for line in page.lines)
