"""The terminal: output of commands, progress bars, and checks before any work."""

import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from ortilo_drake.flight.files import check_output, write_text
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.input_error import one_line
from ortilo_drake.views.page.shell import versions

# Results go to stdout, progress and errors to stderr.
out = Console(highlight=False)
err = Console(stderr=True, highlight=False)
PACE_OVER = 600.0  # time over which a bar averages the speed; parts of a study may arrive minutes apart [s]
SAID_EVERY = 5.0  # interval between lines of progress where there is no bar [s]


def write_json(path: Path | None, report: Any) -> None:
    """Write a report as plain data to a JSON file, if a file is given."""
    if path is not None:
        write_text(path, json.dumps(as_data(report), indent=2, allow_nan=False) + "\n")


def check_writable(*paths: Path | None) -> None:
    """Raise InputError, before any work, if a file cannot be written; the error names the file and the reason."""
    for path in paths:
        if path is not None:
            check_output(path)


def progress_bar() -> Progress:
    """Return a progress bar on stderr, shown only in a terminal and removed when done."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=err, transient=True, disable=not err.is_terminal, speed_estimate_period=PACE_OVER)


@contextmanager
def flights_to_go(what: str = "flights") -> Iterator[Callable[[int, int | None], None]]:
    """Show the progress of flights, or of `what`, and the time left; yield a function of (done, total).

    While the number is not known yet, `total` is None and no time is shown. Flights done until then, or kept from an
    earlier run, do not count for the speed. In a terminal the progress is a bar, elsewhere a line on stderr every
    SAID_EVERY seconds.
    """
    began: tuple[int, float] | None = None
    said = time.monotonic()
    with progress_bar() as progress:
        task = progress.add_task(what, total=None)

        def advance(done: int, total: int | None) -> None:
            nonlocal began, said
            now = time.monotonic()
            first, start = began = began if began and total is not None else (done, now)  # the speed counts from here
            progress.update(task, completed=done, total=total)
            if err.is_terminal or now - said < SAID_EVERY:
                return
            if total is None:
                said = now
                say_error(f"{done:,} {what}, their total number is not known yet")
            elif done > first:
                said, left = now, (total - done) * (now - start) / (done - first)
                say_error(f"{done:,} of at most {total:,} {what}, at most {timedelta(seconds=round(left))} left")

        yield advance


@contextmanager
def bar(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar; yield its update function, with Rich's arguments advance, completed, total, description."""
    with progress_bar() as progress:
        yield partial(progress.update, progress.add_task(what, total=total))


def made_by() -> str:
    """Return the last lines of a report: the command that made the report, and the versions."""
    return f"\nMade by `{shlex.join(['ortilo', *sys.argv[1:]])}` with {versions()}.\n"


def say_written(*paths: Path | None) -> None:
    """Print the names of the files that were written; None is left out."""
    for path in paths:
        if path is not None:
            say(f"  wrote {path}")


def hand_over(text: str, report: Path, data: Any, json_file: Path | None, *figures: Path | None) -> None:
    """Write a study's report and data, print the report and the names of all files; the figures are already written."""
    write_text(report, text + made_by())
    write_json(json_file, data)
    show_markdown(text)
    say_written(report, *figures, json_file)


def say(line: str, end: str = "\n") -> None:
    """Print a line on stdout, without markup."""
    out.print(line, markup=False, soft_wrap=True, end=end)


def say_lines(lines: Iterable[str]) -> None:
    """Print lines, indented below a heading, without markup."""
    for line in lines:
        say(f"  {line}")


def say_if_compiling() -> None:
    """Print that the first flight of an installation compiles its functions, unless compiled functions are kept."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(own) if own else Path(__file__).parents[1]
    if next(folder.rglob("*.nbi"), None) is None:
        say_error("compiling, only this once: half a minute to two minutes")


def say_error(line: str) -> None:
    """Print a line on stderr, without markup."""
    err.print(line, markup=False, soft_wrap=True)


DOUBTFUL = 3  # exit code of a doubtful result, and of a check with warnings


def say_warnings(lines: Iterable[str]) -> None:
    """Print warnings on stderr about settings that are probably mistakes; the scenario flies nevertheless."""
    for line in lines:
        say_error(f"warning  {line}")


def say_heading(name: str, rest: str = "") -> None:
    """Print a name in bold and the text after it; a name such as `[/x]` is not read as markup."""
    out.print(Text.assemble((one_line(name), "bold"), rest), soft_wrap=True)


def show_rows(rows: dict[str, str]) -> None:
    """Print names and values: a table in a terminal, plain lines when piped."""
    if out.is_terminal:
        table = Table(box=box.SIMPLE, show_header=False, pad_edge=False)
        table.add_column(style="cyan", no_wrap=True)
        table.add_column()
        for name, value in rows.items():
            table.add_row(Text(name), Text(value))
        out.print(table)
        return
    say_lines(f"{name:18}  {value}" for name, value in rows.items())


def show_markdown(text: str) -> None:
    """Print Markdown: unchanged when piped; in a terminal with drawn tables and the heading as the first line."""
    if out.is_terminal:
        heading, _, rest = text.partition("\n") if text.startswith("# ") else ("", "", text)
        if heading:
            out.print(Text(heading.removeprefix("# "), style="bold"), soft_wrap=True)
        out.print(Markdown(rest))
    else:
        say(text)


def show_report(report: Any) -> None:
    """Print a report, one line for each entry."""
    for name, value in as_data(report).items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {_number(part)}" for key, part in value.items() if not isinstance(part, dict))
        value = "none" if value == "" else value
        say(f"  {name.replace('_', ' '):20}{_number(value)}")


def _number(value: Any) -> str:
    return three_digits(value) if isinstance(value, float) else str(value)


def three_digits(value: float) -> str:
    """Return a number with three digits, without an exponent from 1e-4 to 1e6: 1370 for 1373.2."""
    return f"{float(f'{value:.3g}'):g}"
