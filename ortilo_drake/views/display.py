"""A flight in Meshcat: live in the browser, or as one HTML page."""

from collections.abc import Callable

import xarray as xr

from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.scenery.meshcat_draw import draw_plan
from ortilo_drake.world.scenery.meshcat_replay import html_replay
from ortilo_drake.world.scenery.meshcat_room import draw_room, make_meshcat


def flight_page(flight: xr.Dataset) -> str:
    """Return a flight as one self-contained HTML page that plays it."""
    scenario = scenario_of(flight)
    room = scenario.load_room()
    return html_replay(
        room,
        plan(scenario.planner, room, scenario.vehicle),
        flight["time"].values,
        flight["truth"].values,
        flight["estimate"].values,
        flight["covariance"].values,
        vehicle=scenario.vehicle,
    )


def fly_live(
    scenario: Scenario, say: Callable[[str], None], progress: Callable[[int], None] | None = None
) -> xr.Dataset:
    """Fly in real time while Meshcat shows it in the browser.

    Args:
        scenario: the scenario.
        say: called with the address to open.
        progress: as in fly.
    """
    room = scenario.load_room()
    meshcat = make_meshcat()
    draw_room(meshcat, room)
    draw_plan(meshcat, plan(scenario.planner, room, scenario.vehicle))
    say(f"open {meshcat.web_url()}")
    return fly(scenario, progress, meshcat)
