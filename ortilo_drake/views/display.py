"""A live flight in Meshcat, shown in the browser."""

from collections.abc import Callable

import xarray as xr
from pydrake.trajectories import Trajectory

from ortilo_drake.flight.flight import fly
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Scenario
from ortilo_drake.views.guarded.guard import Guard, hidden_meshcat
from ortilo_drake.views.guarded.panel import Panel
from ortilo_drake.world.scenery.meshcat_replay import draw_plan
from ortilo_drake.world.scenery.meshcat_room import draw_room


def fly_live(
    scenario: Scenario, say: Callable[[str], None], progress: Callable[[int], None] | None = None
) -> xr.Dataset:
    """Fly in real time while Meshcat shows it in the browser.

    `say` is called with lines of text: the address to open, and what the guard refused. `progress` is as in fly.
    """
    room = scenario.load_room()
    meshcat = hidden_meshcat()
    draw_room(meshcat, room)
    path = planned(scenario)
    if isinstance(path, Trajectory):
        draw_plan(meshcat, path)
    with Guard(meshcat, Panel(), refused=lambda line: say(f"refused: {line}")) as guard:
        say(f"open {guard.url}")
        return fly(scenario, progress, meshcat)
