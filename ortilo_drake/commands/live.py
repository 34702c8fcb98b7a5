"""The command `ortilo live`: a flight during which the user changes the world."""

import contextlib
from typing import Annotated

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import err, out, say, say_error, say_if_compiling, say_warnings
from ortilo_drake.model.input_error import InputError
from ortilo_drake.scenario import load_scenario


def live(
    scenario: options.ScenarioArgument = options.DEFAULT_SCENARIO,
    seed: options.SeedOption = None,
    settings: options.SetOption = None,
    camera: options.CameraOption = None,
    detector: options.DetectorOption = None,
    onnx: options.OnnxOption = None,
    port: Annotated[
        int | None, typer.Option(min=1024, max=65535, help="Port of the page; by default any free port.")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait/--no-wait", help="Take off only once the page is open.")] = True,
) -> None:
    """Fly in the browser and change the world meanwhile: losses, a push, the mass, goals, pause, single ticks, speed.

    The vehicle takes off when the page is opened. The page's button "stop", or Ctrl-C, ends the flight. The page opens
    on this machine only, and only by the printed address, which holds a new random token.
    """
    chosen = load_scenario(scenario, options.with_camera(settings, camera, detector, onnx), seed)
    from pydrake.trajectories import Trajectory
    from rich.live import Live
    from rich.text import Text

    from ortilo_drake.flight.flyable import check_flyable
    from ortilo_drake.hil.goals.goals import GoalPlanner
    from ortilo_drake.hil.live.controls import Controls
    from ortilo_drake.hil.live.scene import Scene
    from ortilo_drake.hil.live.session import Status, fly_live, wait_for_page
    from ortilo_drake.onboard.planner.planned import planned
    from ortilo_drake.sensors.described import unwired
    from ortilo_drake.studies.cautions.cautions import cautions
    from ortilo_drake.views.guarded.guard import Guard, hidden_meshcat
    from ortilo_drake.views.guarded.panel import Panel

    say_warnings(cautions(chosen, scenario, settings or ()))
    say_if_compiling()
    path = planned(chosen)
    check_flyable(chosen, path)
    room, meshcat, panel = chosen.load_room(), hidden_meshcat(), Panel()
    goal = path.value(path.end_time())[:2, 0] if isinstance(path, Trajectory) else room.interior.min[:2]
    controls = Controls(meshcat, panel, room, chosen.sensors, (float(goal[0]), float(goal[1])))
    lamps = unwired(chosen.sensors)
    scene = Scene(meshcat, room, chosen.vehicle, lamps)
    status: Status | None = None
    readings = b"null"  # no readings before the first tick

    def show(now: Status) -> None:
        nonlocal status, readings
        status, readings = now, now.json()
        shown.update(Text(now.line()))

    def refused(line: str) -> None:
        say_error(f"refused: {line}")

    guard = Guard(meshcat, panel, port, lambda: readings, refused)
    try:
        with contextlib.suppress(KeyboardInterrupt), guard:
            say(f"open {guard.url} (readings on the left, controls on the right; Ctrl-C ends)")
            if wait:
                out.print("the vehicle takes off when the page is opened; --no-wait takes off at once", soft_wrap=True)
                wait_for_page(meshcat.GetNumActiveConnections)
            with Live(console=err, refresh_per_second=8, transient=True) as shown, GoalPlanner(chosen) as planner:
                fly_live(chosen, planner, controls.wishes, scene, show)
    except RuntimeError as error:  # from Drake: Meshcat's thread has ended, or the renderer cannot draw
        raise InputError(f"the flight ended: {error}") from None
    say(status.line() if status else "not flown")
