"""The page of a flight: a 3D replay with lamps, errors, arrivals and camera pictures, usable without a network."""

import base64
import json
import shlex
from html import escape
from typing import Any

import numpy as np
import xarray as xr
from pydrake.trajectories import Trajectory

from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.summary import Summary
from ortilo_drake.flight.verdict import ending
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.optional import later
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.views.page.flight_data import blackout_zones, finite_part, flight_data
from ortilo_drake.views.page.shell import Rows, asset, embedded, facts, versions, whole_page
from ortilo_drake.views.page.svg import arrival_plot, error_plot, plan_svg, time_ticks
from ortilo_drake.views.scene_view import draw_boxes, make_camera_view
from ortilo_drake.world.scenery.meshcat_replay import html_replay

cv2 = later("cv2")

RATE = 2.0  # rate of the pictures [Hz]
WIDTH = 320  # width of the pictures [px]
QUALITY = 60  # JPEG quality of the pictures
LARGEST = 4_000_000  # most characters of all pictures; of more, only every second, third, ... picture is kept


def onboard_pictures(flight: xr.Dataset) -> dict[str, Any]:
    """Return the pictures of a flight with a rendered camera, at 2 Hz, with the boxes found in them.

    A flight keeps no pictures: they are drawn again from its true states, which gives the same pictures. `time` [s] and
    `jpeg` (base64) have an entry for each picture. Without pictures both are empty and `none` has the reason.
    """
    scenario = scenario_of(flight)
    if not scenario.is_rendered:
        return {"time": [], "jpeg": [], "none": "this flight has no rendered camera"}
    try:
        view = make_camera_view(scenario)
    except InputError as error:
        return {"time": [], "jpeg": [], "none": str(error)}
    room, times, pictures = scenario.load_room(), [], []
    every = max(1, round(1 / (RATE * scenario.h)))
    for time, x in zip(flight["time"].values[::every], flight["truth"].values[::every], strict=True):
        picture, boxes = view(float(time), x)
        height = round(WIDTH * picture.shape[0] / picture.shape[1])
        large = cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)
        draw_boxes(large, boxes, room, WIDTH / picture.shape[1])
        _, jpeg = cv2.imencode(".jpg", large, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        times.append(round(float(time), 3))
        pictures.append(base64.b64encode(jpeg.tobytes()).decode())
    kept = np.arange(0, len(pictures), max(1, -(-sum(map(len, pictures)) // LARGEST)))
    return {"time": [times[i] for i in kept], "jpeg": [pictures[i] for i in kept]}


CONTROLS = """<div class="bar">
<button id="play" type="button">Play</button>
<input id="seek" type="range" aria-label="time" min="0" max="1" step="any" value="0">
<output id="clock">0.0 s</output>
<select id="speed" aria-label="speed"><option value="0.25">¼×</option><option value="0.5">½×</option>
<option value="1" selected>1×</option><option value="2">2×</option><option value="5">5×</option></select>
</div>"""
# Meshcat's own controls would play another time than the page's controls. Meshcat's legend is above the room, left of
# the page's buttons, and would cover a small window.
IN_SCENE = """<style>.dg { display: none !important } #legend { font-size: 11px; padding: 4px 8px; right: 205px }
@media (max-width: 600px), (max-height: 300px) { #legend { display: none } }</style></body>"""
VIEWS = """<div class="views"><button id="fit" type="button" aria-pressed="true">Whole room</button>
<button id="follow" type="button" aria-pressed="false">Follow</button></div>"""


def flight_page(flight: xr.Dataset) -> str:
    """Return a flight as one self-contained HTML page; InputError if fewer than two of its ticks are finite."""
    scenario, flown = scenario_of(flight), finite_part(flight)
    room, path = scenario.load_room(), planned(scenario)
    zones, data = blackout_zones(scenario, room), flight_data(flown)
    scene = html_replay(
        room,
        path if isinstance(path, Trajectory) else None,
        flown["time"].values,
        flown["truth"].values,
        flown["estimate"].values,
        flown["covariance"].values,
        vehicle=scenario.vehicle,
        zones=zones,
    ).replace("</body>", IN_SCENE)
    pictures = onboard_pictures(flown)
    corners = [list(room.interior.min), list(room.interior.max)]
    # Flights of an ensemble have no measured real-time factor; the page does not show it.
    found = summary(flight.assign_attrs(real_time_factor=flight.attrs.get("real_time_factor", float("nan"))))
    lamps = "".join(
        f'<span class="lamp" id="lamp-{i}" data-sensor="{escape(s["name"])}"><i></i>{escape(s["name"])} <b></b></span>'
        for i, s in enumerate(data["sensors"])
    )
    plots = "".join(error_plot(data, i) for i in range(3)) + "".join(arrival_plot(data, s) for s in data["sensors"])
    title = f"{scenario.name}, seed {scenario.seed}"
    eye = '<figure id="eye"><img alt="what the camera sees"><figcaption>onboard camera</figcaption></figure>'
    body = f"""<header><h1>{escape(title)}</h1>{_ending(flight, found)}</header>
<main>
<section class="stage"><div class="scene"><iframe id="scene" title="flight in 3D" srcdoc="{escape(scene)}"></iframe>
{VIEWS}</div>
<div class="side">{eye if pictures["jpeg"] else ""}{plan_svg(room, zones, flown["reference"].values, data)}
<p class="key"><span class="k planned">planned</span><span class="k truth">true</span>
<span class="k estimate">estimate</span><span class="k anchor">anchor</span><span class="k landmark">landmark</span>
{'<span class="k zone">blackout</span>' if zones else ""}</p></div></section>
<section class="panel">{CONTROLS}<div class="lamps">{lamps}</div></section>
<section class="plots"><h2>Errors in their 3σ bands, and arrivals</h2>{plots}
<div class="ticks">{time_ticks(data)}</div>
<p class="unit">time [s]; strips: blackouts; grey marks: expected, but none came</p>
</section>
<section><h2>Figures</h2>{facts(_figures(found))}</section>
<section><h2>How it was flown</h2>{facts(_origin(flight, scenario, pictures.get("none")))}
<details><summary>The whole scenario</summary><pre>{escape(scenario.model_dump_json(indent=1))}</pre></details>
</section>
</main>
<script type="application/json" id="data">{embedded(data | {"pictures": pictures, "room": corners})}</script>"""
    return whole_page(title, body, asset("flight.js"))


def _ending(flight: xr.Dataset, found: Summary) -> str:
    if found.lost is None:
        return f"<p>{ending(flight)}</p>"
    return f'<p class="lost">lost at {found.lost.time:.2f} s: {escape(found.lost.cause)}</p>'


def _figures(found: Summary) -> Rows:
    """Return the rows of the flight's figures, as `ortilo fly` prints them."""
    rows = [(f"mean squared error {axis}", f"{found.mse[axis]:.5f} m²") for axis in AXES]
    rows += [
        ("farthest from the path", f"{found.max_path_distance:.3f} m"),
        ("farthest from the reference", f"{found.max_reference_distance:.3f} m"),
        ("position NEES", f"{found.nees:.2f} (3 if consistent)"),
    ]
    for sensor, rate in found.arrivals.items():
        if rate is not None:
            rows.append((f"{sensor}: fixes used", f"{rate:.1%}"))
    for sensor, error in found.fix_errors.items():
        rows.append((f"{sensor}: error of fixes", f"median {error.median:.3f} m, 95 % within {error.p95:.3f} m"))
    if found.contacts:
        rows.append(("touched", ", ".join(found.contacts)))
    return rows


def _origin(flight: xr.Dataset, scenario: Scenario, no_pictures: str | None) -> Rows:
    """Return the rows on the flight's origin: scenario, versions, and the command that repeats it."""
    command = repeat_command(scenario)
    rows = [
        ("scenario", scenario.name),
        ("seed", str(scenario.seed)),
        ("flown with", str(flight.attrs.get("software", "not recorded"))),
        ("page made with", versions()),
        ("repeat it", f"$ {command}" if command else "save the scenario below as a .yaml file and fly that"),
    ]
    return rows + ([("no pictures", no_pictures)] if no_pictures else [])


def repeat_command(scenario: Scenario) -> str | None:
    """Return the `ortilo fly` command that repeats a scenario with its seed; None if no such command is known.

    The differences from the ready-made scenario of the same name are in --set. The command is checked to load this very
    scenario. For a user's file the answer is None, because a flight does not know where the file is.
    """
    try:
        base = load_scenario(scenario.name).model_dump(mode="json")
        wanted = scenario.model_dump(mode="json")
        settings = tuple(f"{key}={json.dumps(value)}" for key, value in _differences(base, wanted) if key != "seed")
        if load_scenario(scenario.name, settings, scenario.seed) != scenario:
            return None
    except InputError:
        return None
    words = ["ortilo", "fly", scenario.name, "--seed", str(scenario.seed)]
    for setting in settings:
        words += ["--set", setting]
    return shlex.join(words)


def _differences(base: dict[str, Any], wanted: dict[str, Any], path: str = "") -> list[tuple[str, Any]]:
    """Return the dotted keys and the values of the settings in `wanted` that differ from `base`."""
    found: list[tuple[str, Any]] = []
    for name, value in wanted.items():
        before = base.get(name)
        if value == before:
            continue
        if isinstance(value, dict) and isinstance(before, dict) and value.keys() == before.keys():
            found += _differences(before, value, f"{path}{name}.")
        else:
            found.append((path + name, value))
    return found
