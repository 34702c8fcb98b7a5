"""The command `ortilo report`: one page of what another command wrote."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import quiet_drake
from ortilo_drake.commands.terminal import check_writable, say_written
from ortilo_drake.flight.files import write_text
from ortilo_drake.model.input_error import InputError


def report(
    path: Annotated[
        Path,
        typer.Argument(help="A flight's .nc, or the --out folder or --json file of tables, analyze, sensitivity, hil."),
    ],
    html: Annotated[
        Path | None, typer.Option("--out", help="The page; PATH.html, or report.html in PATH, if it is a folder.")
    ] = None,
) -> None:
    """Make one self-contained HTML page, text, tables and figures in it, of what another command wrote."""
    page = html or (path / "report.html" if path.is_dir() else path.with_name(f"{path.stem}.html"))
    if page.resolve() == path.resolve():
        raise InputError(f"--out {page}: is the file to report on")
    check_writable(page)
    if path.suffix == ".nc":
        from ortilo_drake.flight.saved_flight import load_flight
        from ortilo_drake.views.page.flight_page import flight_page

        quiet_drake()
        text = flight_page(load_flight(path))
    else:
        from ortilo_drake.views.page.report_page import report_page

        text = report_page(path)
    write_text(page, text)
    say_written(page)
