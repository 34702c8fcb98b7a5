"""The command `ortilo room survey`: the positions of the anchors, from ranges."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ortilo_drake.commands.options import JsonOption, RoomFileOption, finite
from ortilo_drake.commands.terminal import bar, say, say_lines, say_written, write_json
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.numbers import whole

if TYPE_CHECKING:
    import numpy as np

    from ortilo_drake.model.room import Room
    from ortilo_drake.scenario import Scenario
    from ortilo_drake.studies.room_design.network import Ranges
    from ortilo_drake.studies.room_design.survey import Survey


class Loss(StrEnum):
    """The cost function of a residual; all except `linear` are robust against outliers."""

    linear = "linear"
    soft_l1 = "soft_l1"
    huber = "huber"
    cauchy = "cauchy"


def survey(
    sources: Annotated[
        list[Path], typer.Argument(help="Flights (.nc), logs (.mcap or their folder) and tables of ranges (.csv).")
    ],
    known: Annotated[str, typer.Option(help="Numbers of the anchors with known places, three or more.")] = "0,1,2",
    room: Annotated[
        str | None,
        typer.Option(help="Room with the assumed anchors: 'ortilo' or a file; by default the flights' room."),
    ] = None,
    loss: Annotated[Loss, typer.Option(help="Cost of a residual; all but linear tolerate outliers.")] = Loss.linear,
    range_sd: Annotated[
        float | None, typer.Option(min=0.0, callback=finite, help="Standard deviation of a range, in m.")
    ] = None,
    range_fraction: Annotated[
        float | None, typer.Option(min=0.0, callback=finite, help="Growth of --range-sd for each metre of distance.")
    ] = None,
    most: Annotated[int, typer.Option(min=4, max=5000, help="Use at most this many positions of a flight.")] = 200,
    out_file: RoomFileOption = None,
    json_file: JsonOption = None,
) -> None:
    """Find the anchors' positions from ranges to the vehicle and between anchors; three anchors fix the frame.

    A table has the columns from, to, range and, where known, x, y, z, sd; anchors are called a0, a1 and so on, other
    names in `from` are positions of the vehicle. Without --range-sd and --range-fraction the noise is what the
    flights' multilateration assumes; without flights, 0.75 % of the distance.
    """
    numbers = _numbers(known)
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.studies.room_design.place import room_text, with_anchors
    from ortilo_drake.studies.room_design.survey import doubts
    from ortilo_drake.studies.room_design.survey import survey as find

    with bar("surveying"):
        surveyed, ranges, scenario = _read(sources, room, most)
        noise = _noise(scenario, range_sd, range_fraction)
        found = find(ranges, surveyed.anchor_positions, numbers, noise, loss.value)
    if out_file is not None:
        about = f"The room {surveyed.name} with its anchors as ortilo room survey found them."
        write_text(out_file, room_text(with_anchors(surveyed, found.anchors), about))
    doubted = doubts(found, ranges)
    moved = found.anchors - surveyed.anchor_positions
    report = {"room": surveyed.name, "known": numbers, "anchors": found.anchors, "sd": found.sd, "moved": moved}
    counts = {"ranges": found.ranges, "places": len(found.places), "chi2": found.chi2, "freedom": found.freedom}
    write_json(json_file, report | counts | {"doubts": doubted, "covariance": found.covariance})
    _print_survey(surveyed.name, found, moved, numbers)
    say_lines(doubted)
    say_written(out_file, json_file)


def _numbers(known: str) -> list[int]:
    try:
        return [whole(word) for word in known.split(",")]
    except ValueError:
        raise InputError(f"--known {known!r}: must be numbers of anchors, separated by commas, such as 0,1,2") from None


def _noise(scenario: "Scenario | None", sd: float | None, fraction: float | None) -> tuple[float, float]:
    if sd is not None or fraction is not None:
        if not (sd or fraction):
            raise InputError("--range-sd, --range-fraction: one of them must be above 0")
        return sd or 0.0, fraction or 0.0
    if scenario is None:
        return 0.0, 0.0075
    return scenario.multilateration.noise.sds


def _read(sources: list[Path], room: str | None, most: int) -> "tuple[Room, Ranges, Scenario | None]":
    """Return the room with the believed anchors, the ranges of all sources, and the scenario of the first flight."""
    from ortilo_drake.flight.flight import scenario_of
    from ortilo_drake.flight.saved_flight import load_flight
    from ortilo_drake.interop.log.reader import log_scenario
    from ortilo_drake.model.room import ORTILO_ROOM, load_room
    from ortilo_drake.studies.room_design.survey_data import (
        flown_messages,
        ranges_of_flight,
        ranges_of_log,
        ranges_of_table,
        together,
    )

    parts: list[Ranges] = []
    scenarios: list[Scenario] = []
    for file in (file for file in sources if file.suffix != ".csv"):
        if file.suffix == ".nc":
            flight = load_flight(file)
            scenario = scenario_of(flight)
            parts.append(ranges_of_flight(flight, scenario, flown_messages(scenario, flight["truth"].values), most))
        else:
            scenario = log_scenario(file)
            parts.append(ranges_of_log(file, most))
        if scenarios and scenario.load_room() != scenarios[0].load_room():
            raise InputError(f"{file}: was flown in another room than {sources[0]}")
        scenarios.append(scenario)
    if room is not None:
        surveyed = load_room(ORTILO_ROOM if room == "ortilo" else Path(room))
    else:
        surveyed = scenarios[0].load_room() if scenarios else load_room()
    n = len(surveyed.anchors)
    if scenarios and len(scenarios[0].load_room().anchors) != n:
        raise InputError(
            f"--room {room}: has {n} anchors: must have {len(scenarios[0].load_room().anchors)}, as in the flights"
        )
    parts += [ranges_of_table(file, n) for file in sources if file.suffix == ".csv"]
    return surveyed, together(parts), scenarios[0] if scenarios else None


def _print_survey(name: str, found: "Survey", moved: "np.ndarray", known: list[int]) -> None:
    fit = f", chi² {found.chi2:.0f} of {found.freedom} expected" if found.freedom > 0 else ""
    say(f"{name}: {found.ranges} ranges, {len(found.places)} places{fit}")
    for i, (p, sd, step) in enumerate(zip(found.anchors, found.sd, moved, strict=True)):
        where = f"  a{i:<3} ({p[0]:8.3f}, {p[1]:8.3f}, {p[2]:8.3f}) m"
        if i in known:
            say(f"{where}  known")
            continue
        spread, far = ", ".join(f"{value:.3f}" for value in sd), float((step @ step) ** 0.5)
        say(f"{where}  sd ({spread}) m, {far:.3f} m from the assumed position")
