"""The command `ortilo room coverage`: it finds the places where a room loses a vehicle."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from ortilo_drake.commands.options import JsonOption, SetOption
from ortilo_drake.commands.room.show import PngOption
from ortilo_drake.commands.terminal import bar, say, say_written, write_json

if TYPE_CHECKING:
    from ortilo_drake.scenario import Scenario
    from ortilo_drake.studies.rooms.coverage import Coverage


def coverage(
    what: Annotated[str, typer.Argument(metavar="SCENARIO_OR_ROOM", help="A scenario, or a room's .yaml file.")],
    settings: SetOption = None,
    png: PngOption = None,
    json_file: JsonOption = None,
) -> None:
    """Find where a room loses a vehicle, and map what can be seen and measured in it.

    In a room the vehicle flies from start to goal with IMU, projected camera, and UWB that walls block. The floor is
    the smallest error of the position that any estimator can have (the Cramér-Rao bound). The JSON file holds:

    - scenario, room, and the answer in words.
    - worst: the stretch with the largest floor [m]: first and last tick; the silent sensors; the sensor on which the
      floor hangs_on most, and the floor_without it [m].
    - cases: with 'all' sensors, and without each: the largest floor [m], its time [s] and distance [m], lost_at [s].
    - along: at n points of the path time [s], distance [m], position [m], free space to the walls [m], anchors in
      sight, pdop (null: no position), floor [m] in each case, and landmarks at the heading flown; for h headings [rad]
      landmarks_by_heading (n, h).
    - over_floor: on a grid of x and y at one height [m], free, anchors and pdop (y, x), and landmarks (heading, y, x).
    """
    from ortilo_drake.studies.rooms.room_scenario import scenario_of, without_camera

    scenario = scenario_of(what, tuple(settings or ()))
    from ortilo_drake.studies.rooms.coverage import coverage as cover
    from ortilo_drake.studies.rooms.coverage_figure import coverage_figure

    with bar("coverage", 100) as update:
        found = cover(scenario, lambda share: update(completed=round(100 * share)))
    say(f"Where will {found.room} lose you? {found.answer}")
    for name, case in found.cases.items():
        who = "all sensors" if name == "all" else f"without {name}"
        lost = "stays off the walls" if case.lost_at is None else f"reaches a wall at {case.lost_at:.1f} s"
        worst = f"floor at most {case.floor:.3g} m, at {case.distance:.1f} m ({case.time:.1f} s)"
        say(f"  {who:20}{worst}, {lost}")
    for line in _along_the_way(found, scenario):
        say(f"  {line} along the way")
    if flown := without_camera(scenario):
        say(f"  {'flown':20}{flown}")
    write_json(json_file, found)
    if png is not None:
        coverage_figure(found, scenario.load_room(), png)
    say_written(png, json_file)


def _along_the_way(found: "Coverage", scenario: "Scenario") -> Iterator[str]:
    """Yield lines with the ranges of what the sensors that fly can measure along the path."""
    along = found.along
    if scenario.measures_ranges:
        yield f"{'anchors in sight':20}{along.anchors.min()} to {along.anchors.max()}"
        finite = along.pdop[along.pdop < float("inf")]
        none = "" if len(finite) == len(along.pdop) else f", none at {1 - len(finite) / len(along.pdop):.0%}"
        spread = f"{finite.min():.2f} to {finite.max():.2f}" if len(finite) else "none"
        yield f"{'PDOP':20}{spread}{none if len(finite) else ''}"
    if scenario.sees_landmarks:
        yield f"{'landmarks in view':20}{along.landmarks.min()} to {along.landmarks.max()}"
