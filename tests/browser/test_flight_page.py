"""The page of a flight in headless Chromium: it plays, seeks and pauses, its lamps follow the arrivals, offline."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from browser.chromium import Page

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.views.page.flight_page import flight_page

pytestmark = pytest.mark.long

# Its UWB is gone from 1 s to 2 s, and a third of its fixes are lost: lamps are lit, dark and red in turn.
SETTINGS = (
    "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}",
    "camera.kind=projected",
    "uwb.link.blackouts=[{kind: time, start: 1.0, end: 2.0}]",
    "uwb.link.loss=0.5",
)
LIT = 0.2  # [s]


@pytest.fixture(scope="module")
def flight(flown: Any) -> xr.Dataset:
    found: xr.Dataset = flown("imu_uwb_yolo", SETTINGS, 0)
    return found


@pytest.fixture(scope="module")
def opened(flight: xr.Dataset, tab: Page, tmp_path_factory: pytest.TempPathFactory) -> Page:
    file = tmp_path_factory.mktemp("page") / "flight.html"
    file.write_text(flight_page(flight), encoding="utf-8")
    tab.errors.clear()
    tab.requests.clear()
    tab.open(file.as_uri())
    tab.until("flight.viewer() !== null")
    return tab


@pytest.fixture
def page(opened: Page) -> Page:
    """The page at its start, at rest."""
    opened.run("if (flight.playing()) document.getElementById('play').click(); flight.seek(0)")
    return opened


def test_it_starts_at_rest(page: Page) -> None:
    assert page.run("flight.playing()") is False
    assert page.run("document.getElementById('play').textContent") == "Play"


def test_it_plays_and_pauses(page: Page) -> None:
    page.run("document.getElementById('play').click()")
    page.until("flight.time() > 0.3")
    page.run("document.getElementById('play').click()")
    held = page.run("flight.time()")
    page.run("new Promise((done) => setTimeout(done, 300))")
    assert page.run("flight.time()") == held


def test_it_stops_at_the_end(page: Page, flight: xr.Dataset) -> None:
    end = float(flight["time"].values[-1])
    page.run(f"flight.seek({end - 0.2})")
    page.run("document.getElementById('play').click()")
    page.until("!flight.playing()")
    assert page.run("flight.time()") == pytest.approx(end, abs=1e-3)


@pytest.mark.parametrize("part", [0.0, 0.37, 1.0])
def test_seeking_moves_vehicle_plan_and_cursor(page: Page, flight: xr.Dataset, part: float) -> None:
    time = flight["time"].values
    k = round(part * (len(time) - 1))
    page.run(f"document.getElementById('seek').value = {time[k]}")
    page.run("document.getElementById('seek').dispatchEvent(new Event('input'))")
    truth, estimate = flight["truth"].values[k, :3], flight["estimate"].values[k, :3]
    for name, p_W in (("truth", truth), ("estimate", estimate)):
        place = page.run(f"['cx', 'cy'].map((a) => Number(document.getElementById('at-{name}').getAttribute(a)))")
        np.testing.assert_allclose(place, p_W[:2], atol=2e-3)
    cursor = page.run("parseFloat(document.querySelector('.cursor').getAttribute('d').slice(1))")
    assert cursor == pytest.approx(1000 * time[k] / time[-1], abs=0.1)
    assert page.run("document.getElementById('clock').textContent").startswith(f"{time[k]:.1f} /")
    # Where Meshcat's own scene has the vehicle; it plays 15 frames a second, and this flies at most 1 m/s.
    x, y, z = page.run("flight.viewer().scene_tree.find(['flight', 'vehicle']).object.position.toArray()")
    np.testing.assert_allclose([x, y, z], truth, atol=0.08)


def expected_lamp(flight: xr.Dataset, sensor: str, time: float) -> str:
    if sensor == "uwb" and 1.0 <= time < 2.0:
        return "blackout"
    used = flight["time"].values[flight["arrival"].sel(sensor=sensor).values]
    return "fix" if np.any((used <= time + 1e-9) & (used >= time - LIT)) else "none"


def test_lamps_follow_the_arrivals(page: Page, flight: xr.Dataset) -> None:
    end = float(flight["time"].values[-1])
    seen = set()
    for time in np.arange(0.0131, end, 0.0717):  # never just where a lamp changes
        page.run(f"flight.seek({time})")
        lamps = page.run("[...document.querySelectorAll('.lamp')].map((l) => [l.dataset.sensor, l.dataset.state])")
        assert [name for name, _ in lamps] == ["uwb", "camera"]
        for sensor, state in lamps:
            assert state == expected_lamp(flight, sensor, float(time)), (sensor, time)
            seen.add((sensor, state))
    assert {("uwb", "fix"), ("uwb", "blackout"), ("camera", "fix")} <= seen


def test_the_view_follows_the_vehicle_and_goes_back(page: Page, flight: xr.Dataset) -> None:
    target = "flight.viewer().controls.target.toArray()"
    page.run("document.getElementById('fit').click()")
    whole = page.run(target)
    k = len(flight["time"]) // 2
    page.run("document.getElementById('follow').click()")
    page.run(f"flight.seek({flight['time'].values[k]})")
    x, y, z = flight["truth"].values[k, :3]
    np.testing.assert_allclose(page.run(target), [x, z, -y], atol=2e-3)  # the viewer has y up
    page.run("document.getElementById('fit').click()")
    np.testing.assert_allclose(page.run(target), whole, atol=1e-9)


@pytest.mark.parametrize("width", [390, 1280])
def test_the_whole_room_is_in_view(page: Page, flight: xr.Dataset, width: int) -> None:
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=False)
    page.until(
        "(v => Math.abs(v.camera.aspect - v.dom_element.offsetWidth / v.dom_element.offsetHeight) < 1e-3)"
        "(flight.viewer())"
    )
    page.run("document.getElementById('fit').click()")
    page.run("flight.viewer().render()")
    inside = scenario_of(flight).load_room().interior
    for x in (inside.min[0], inside.max[0]):
        for y in (inside.min[1], inside.max[1]):
            corner = f"flight.viewer().controls.target.clone().set({x}, {inside.min[2]}, {-y})"
            seen = page.run(f"{corner}.project(flight.viewer().camera).toArray()")
            assert np.all(np.abs(seen) <= 1.0), (x, y)  # the viewer's window is from -1 to 1


@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_the_width(page: Page, width: int) -> None:
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=False)
    assert page.run("document.documentElement.scrollWidth <= window.innerWidth")


def test_it_prints(page: Page) -> None:
    pdf = page.pdf()
    assert pdf.startswith(b"%PDF-")
    assert 1 <= pdf.count(b"/Type /Page\n") <= 4


def test_nothing_is_asked_of_the_network_and_no_error_said(page: Page) -> None:
    page.run("flight.seek(1)")
    away = [url for url in page.requests if not url.startswith(("file:", "data:", "blob:", "about:"))]
    assert page.requests
    assert away == []
    assert page.errors == []
