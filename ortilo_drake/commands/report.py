"""The command `ortilo report`: one page with another command's results."""

import os.path
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.terminal import check_writable, say_written
from ortilo_drake.flight.files import write_text
from ortilo_drake.model.input_error import InputError


def report(
    path: Annotated[
        Path, typer.Argument(help="A flight's .nc, or the --out folder or --json file of another command.")
    ],
    html: Annotated[
        Path | None,
        typer.Option("--out", help="The page to write; by default PATH.html, or report.html in a folder PATH."),
    ] = None,
    rerun: Annotated[
        Path | None, typer.Option(help="For a flight's .nc: write a recording for Rerun, .rrd, instead of a page.")
    ] = None,
) -> None:
    """Make one self-contained HTML page, with text, tables and figures, of another command's results.

    With --rerun a page is made only if --out is given.
    """
    if rerun is not None:
        _write_recording(path, rerun)
        if html is None:
            return
    page = html or (path / "report.html" if os.path.isdir(path) else path.with_name(f"{path.stem}.html"))
    check_writable(page)
    if os.path.realpath(page) == os.path.realpath(path):  # Path.resolve would raise if links lead in a circle
        raise InputError(f"--out {page}: is the file to report on")
    if path.suffix == ".nc":
        from ortilo_drake.flight.saved_flight import load_flight
        from ortilo_drake.views.page.flight_page import flight_page

        text = flight_page(load_flight(path))
    else:
        from ortilo_drake.views.page.report_page import report_page

        text = report_page(path)
    write_text(page, text)
    say_written(page)


def _write_recording(path: Path, rerun: Path) -> None:
    """Write the flight in a .nc file as a recording for the Rerun viewer."""
    if path.suffix != ".nc":
        raise InputError(f"--rerun: {path}: only a flight's .nc has a recording")
    check_writable(rerun)
    from ortilo_drake.flight.saved_flight import load_flight
    from ortilo_drake.interop.rerun.recording import check_recording, save_recording
    from ortilo_drake.interop.rerun.sightings import drawn_again
    from ortilo_drake.views.scene_view import make_camera_view

    check_recording(rerun)
    flight = load_flight(path)
    save_recording(flight, drawn_again(flight, make_camera_view), rerun)
    say_written(rerun)
