"""The command `ortilo room place`: it finds the best places of anchors for a scenario's path."""

from typing import TYPE_CHECKING, Annotated

import typer

from ortilo_drake.commands.options import JsonOption, RoomFileOption, SetOption, finite
from ortilo_drake.commands.terminal import bar, out, say, say_if_compiling, say_written, write_json
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import MAX_ANCHORS, MAX_LANDMARKS

FIX = 3  # number of anchors that a position needs

if TYPE_CHECKING:
    from ortilo_drake.studies.room_design.place import Worst


def place(
    what: Annotated[str, typer.Argument(metavar="SCENARIO_OR_ROOM", help="A scenario, or a room's .yaml file.")],
    n: Annotated[int, typer.Argument(metavar="N", help="Number of anchors.")],
    landmarks: Annotated[int, typer.Option(help="Number of landmarks to place as well, instead of the room's.")] = 0,
    spacing: Annotated[
        float, typer.Option(min=0.25, max=100.0, callback=finite, help="Spacing of the grid of mounting places, in m.")
    ] = 1.5,
    settings: SetOption = None,
    out_file: RoomFileOption = None,
    json_file: JsonOption = None,
) -> None:
    """Place N anchors on walls and ceiling to minimise the largest position error along the path.

    The error is the Cramér-Rao bound along the planned path: no estimator errs less. A room is flown as by `ortilo room
    coverage`. The best anchors for one path may be worse for another; check yours with `ortilo room coverage SCENARIO
    --set room=ROOM.yaml --set planner.start=[X,Y] --set planner.goal=[X,Y]`. Fly in the written room with `ortilo fly
    SCENARIO --set room=ROOM.yaml`.
    """
    if not FIX <= n <= MAX_ANCHORS:
        raise InputError(f"N: {n}: must be {FIX} to {MAX_ANCHORS}")
    if not 0 <= landmarks <= MAX_LANDMARKS:
        raise InputError(f"--landmarks {landmarks}: must be 0 to {MAX_LANDMARKS}")
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.studies.room_design.place import place_anchors, room_text
    from ortilo_drake.studies.rooms.room_scenario import scenario_of, without_camera

    say_if_compiling()
    chosen = scenario_of(what, tuple(settings or ()))
    with bar("placing") as update:
        found = place_anchors(
            chosen, n, spacing, landmarks, lambda part: update(description=part), lambda: update(advance=1)
        )
    if out_file is not None:
        about = f"The room of {chosen.name} with {n} anchors placed by ortilo room place."
        write_text(out_file, room_text(found.room, about))
    gain = 1.0 - found.after.floor / found.before.floor if found.before.floor > 0.0 else None
    report = {"scenario": chosen.name, "candidates": found.candidates, "before": found.before, "after": found.after}
    placed = [[its.label, *its.position] for its in found.room.landmarks] if landmarks else None
    anchors = [list(p) for p in found.room.anchors]
    write_json(json_file, report | {"gain": gain, "anchors": anchors, "landmarks": placed})
    had = len(chosen.load_room().anchors)
    say(f"{chosen.name}, {n} anchors on {found.candidates} mounting places, the room has {had}")
    _print_worst("before", found.before)
    _print_worst("after", found.after)
    if gain is not None:
        out.print(f"  the bound falls by {gain:.1%}")
    for i, (x, y, z) in enumerate(found.room.anchors):
        out.print(f"  anchor {i:<3} ({x:.3f}, {y:.3f}, {z:.3f})")
    for its in found.room.landmarks if landmarks else ():
        say(f"  {its.label:12} ({', '.join(f'{value:.3f}' for value in its.position)})")
    say_written(out_file, json_file)
    if flown := without_camera(chosen):
        say(f"  flown {flown}")
    if out_file is not None:
        ends = "--set planner.start=[X,Y] --set planner.goal=[X,Y]"
        check = f"  the anchors suit this path; to check another: ortilo room coverage {out_file} {ends}"
        say(check)
        say(f"  to see it: ortilo room show {out_file} --png out/room.png")


def _print_worst(when: str, worst: "Worst") -> None:
    x, y, z = worst.place
    out.print(
        f"  {when:7} error bound {worst.floor:.4f} m at the worst point, ({x:.2f}, {y:.2f}, {z:.2f}), "
        f"{worst.time:.1f} s; longest time with fewer than three ranges {worst.no_fix:.2f} s",
        soft_wrap=True,
    )
