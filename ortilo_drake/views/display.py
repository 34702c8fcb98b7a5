"""A flight in Meshcat, live in the browser."""

from collections.abc import Callable

import xarray as xr
from pydrake.trajectories import Trajectory

from ortilo_drake.flight.flight import fly
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.scenery.meshcat_draw import draw_plan
from ortilo_drake.world.scenery.meshcat_room import draw_room, make_meshcat


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
    path = planned(scenario)
    if isinstance(path, Trajectory):
        draw_plan(meshcat, path)
    say(f"open {meshcat.web_url()}")
    return fly(scenario, progress, meshcat)
