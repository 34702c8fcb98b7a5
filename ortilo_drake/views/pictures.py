"""Writing matplotlib figures to files."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.palette import STYLE
from ortilo_drake.views.themes import apply_theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS: Final = ("png", "svg", "pdf", "eps", "jpg", "jpeg", "tif", "tiff", "webp")
# A figure drawn twice gives the same bytes: no date, no random names.
_UNDATED: Final = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
# Text stays text, to be searched and edited in SVG and PDF; a PDF embeds the fonts.
_KEPT: Any = {"svg.hashsalt": "ortilo", "svg.fonttype": "none", "pdf.fonttype": 42}


class Format(StrEnum):
    """File formats of the figures whose names a command chooses."""

    png = "png"
    svg = "svg"
    pdf = "pdf"


_chosen: ContextVar[Format] = ContextVar("format", default=Format.png)


@contextmanager
def drawn_as(format_: Format) -> Iterator[None]:
    """Let figure_file return names with this format's ending until the block ends."""
    before = _chosen.set(format_)
    try:
        yield
    finally:
        _chosen.reset(before)


def figure_file(folder: Path, stem: str) -> Path:
    """Return the path of a command's figure in its folder, in the format of `ortilo --figures`; PNG by default."""
    return folder / f"{stem}.{_chosen.get()}"


def check_picture(path: Path, endings: tuple[str, ...] = ENDINGS) -> None:
    """Raise InputError, naming the allowed endings, if pictures cannot be written to a file with this ending."""
    if path.suffix[1:].lower() not in endings:
        allowed = ", ".join(f".{ending}" for ending in endings)
        raise InputError(
            f"{path}: unknown kind of picture '{path.suffix}', give {'one of ' * (len(endings) > 1)}{allowed}"
        )


def save_picture(figure: "Figure", path: Path) -> Path:
    """Write a figure in the chosen theme and return its path. Errors as in check_picture and write_bytes."""
    import matplotlib as mpl

    check_picture(path)
    ending, drawn = path.suffix[1:].lower(), io.BytesIO()
    with mpl.rc_context(_KEPT):
        figure.savefig(drawn, format=ending, metadata=_UNDATED.get(ending), **apply_theme(figure))
    write_bytes(path, drawn.getvalue())
    return path


@contextmanager
def figure_to(path: Path, size: tuple[float, float], style: Any = STYLE) -> Iterator["Figure"]:
    """Yield an empty figure of a size [in] and a style; write it when the block ends. Errors as in save_picture."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        save_picture(figure, path)
