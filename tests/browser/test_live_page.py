"""The page of a live flight in headless Chromium: a slider loses messages, pause holds, goals fly, stop ends."""

import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread

import pytest
from browser.chromium import PATIENCE, Page
from planning_at_once import AtOnce

from ortilo_drake.hil.live.controls import GO, GOAL, LOST, PAUSE, SPEED, STOP, Controls
from ortilo_drake.hil.live.scene import Scene
from ortilo_drake.hil.live.session import Status, fly_live
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.guarded.guard import Guard, hidden_meshcat
from ortilo_drake.views.guarded.panel import Panel

pytestmark = pytest.mark.long

NAMED = (
    """Array.from(document.querySelectorAll('.property-name')).find((e) => e.textContent.trim() === %r).parentElement"""
)

DRAWN = """((canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.filter(
    (byte) => byte).length)(document.getElementById(%r))"""


class Flying(Thread):
    """A live flight in a thread, which alone may talk to its Meshcat."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.status, self.url, self.is_ready, self.refused = Status(), "", Event(), list[str]()
        self.readings = b"null"

    def run(self) -> None:
        scenario = load_scenario(
            "imu_uwb_yolo", ("planner={kind: hover, point: [8, 1, 1.5], duration: 5}", "camera.kind=projected")
        )
        meshcat, panel, room = hidden_meshcat(), Panel(), scenario.load_room()
        controls = Controls(meshcat, panel, room, scenario.sensors, (8.0, 1.0))
        scene = Scene(meshcat, room, scenario.vehicle, ("uwb", "camera"))
        with Guard(meshcat, panel, None, lambda: self.readings, self.refused.append) as guard:
            self.url = guard.url
            self.is_ready.set()
            fly_live(scenario, AtOnce(scenario), controls.wishes, scene, self.show)

    def show(self, status: Status) -> None:
        self.status, self.readings = Status(**vars(status)), status.json()

    def until(self, holds: Callable[[Status], bool]) -> Status:
        """Return the first status of which something holds."""
        end = time.monotonic() + PATIENCE
        while not holds(status := self.status):
            assert time.monotonic() < end, status
            time.sleep(0.02)
        return status


@pytest.fixture
def flying(tab: Page) -> Iterator[Flying]:
    flying = Flying()
    flying.start()
    assert flying.is_ready.wait(PATIENCE)
    tab.errors.clear()
    tab.open(flying.url, 720, 320)
    tab.until(f"document.body.innerText.includes({LOST.format('uwb')!r})")
    yield flying
    click(tab, STOP)
    flying.join(PATIENCE)
    assert not flying.is_alive()
    tab.call("Page.navigate", url="about:blank")


def slide(tab: Page, name: str, value: float) -> None:
    tab.run(f"const i{abs(hash((name, value)))} = {NAMED % name}.querySelector('input'); "
            f"i{abs(hash((name, value)))}.value = '{value}'; "
            f"i{abs(hash((name, value)))}.dispatchEvent(new Event('change'))")  # fmt: skip


def click(tab: Page, name: str) -> None:
    tab.run(f"({NAMED % name}).click()")


class Elsewhere(BaseHTTPRequestHandler):
    """A page of another origin on this machine."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!DOCTYPE html><link rel=icon href=data:,><p>elsewhere")

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@pytest.fixture
def elsewhere() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


STOPS = """new Promise((done) => {
    const socket = new WebSocket(%r);
    const stop = Uint8Array.from([0x82, 0xa4, ...txt('type'), 0xa6, ...txt('button'), 0xa4, ...txt('name'),
                                  0xa4, ...txt('stop')]);
    socket.onopen = () => { socket.send(stop); done('open'); };
    socket.onerror = () => done('refused');
})"""  # with the message that stops a flight


def test_before_the_first_tick_the_page_says_what_it_waits_for(tab: Page) -> None:
    meshcat = hidden_meshcat()
    with Guard(meshcat, Panel(), None, lambda: b"null") as guard:
        tab.open(guard.url, 720, 320)
        tab.until("document.body.innerText.includes('waiting for the first tick')")
        tab.call("Page.navigate", url="about:blank")


def test_a_page_of_elsewhere_is_refused_though_it_knows_the_address(tab: Page, flying: Flying, elsewhere: str) -> None:
    tab.open(elsewhere)
    tab.run("window.txt = (text) => Array.from(text, (c) => c.charCodeAt(0)), 0")
    address = flying.url.replace("http:", "ws:")
    assert tab.run(STOPS % address) == "refused"
    assert tab.run(STOPS % address.replace("127.0.0.1", "localhost")) == "refused"
    assert tab.run(f"fetch({flying.url!r}).then(() => 'read', () => 'refused')") == "refused"
    assert flying.refused == [f"Origin {elsewhere.rstrip('/')!r}: another page's"]
    assert flying.is_alive()
    tab.open(flying.url, 720, 320)  # for the end, by its own page
    tab.until(f"document.body.innerText.includes({LOST.format('uwb')!r})")


def test_the_user_changes_the_world_and_the_flight_follows(tab: Page, flying: Flying) -> None:
    slide(tab, SPEED, 5.0)
    before = flying.until(lambda s: s.time > 6.0).arrivals
    assert (before["uwb"] or 0.0) > 0.9
    slide(tab, LOST.format("uwb"), 100.0)
    after = flying.until(lambda s: s.arrivals.get("uwb") == 0.0).arrivals
    assert (after["camera"] or 0.0) > 0.5
    slide(tab, LOST.format("uwb"), 0.0)
    flying.until(lambda s: (s.arrivals.get("uwb") or 0.0) > 0.9)

    click(tab, PAUSE)
    held = flying.until(lambda s: s.is_paused).time
    time.sleep(0.3)
    assert tab.run("document.title") == "imu_uwb_yolo, live"
    assert flying.status.time == held
    stands = flying.status
    read = {"time": f"{held:.1f} s", "state": "paused"}
    read |= {"error": f"{100 * stands.error:.1f} cm", "sd": f"{100 * stands.sd:.1f} cm"}
    for name, text in read.items():
        tab.until(f"document.getElementById({name!r}).textContent === {text!r}")
    assert tab.run("document.querySelectorAll('#lamps span').length") == 2
    for plot in ("of-x", "of-y", "of-z", "strips"):
        tab.until(f"{DRAWN % plot} > 100")
    assert tab.run("viewer.gui.closed") is False
    click(tab, PAUSE)
    flying.until(lambda s: s.time > held)

    for name, value in zip(GOAL, (9.5, 1.8), strict=True):
        slide(tab, name, value)
    click(tab, GO)
    assert "on the way" in flying.until(lambda s: bool(s.note)).note
    assert tab.errors == []
    assert flying.refused == []
