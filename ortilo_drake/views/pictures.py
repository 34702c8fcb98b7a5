"""Files of matplotlib figures."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.themes import apply_theme

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS: Final = ("png", "svg", "pdf", "eps", "jpg", "jpeg", "tif", "tiff", "webp")
# A figure drawn twice gives the same bytes: no date, no names drawn at random.
_UNDATED: Final = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
# Letters stay letters, which a slide program can edit and search.
_KEPT: Any = {"svg.hashsalt": "ortilo", "svg.fonttype": "none", "pdf.fonttype": 42}


def check_picture(path: Path, endings: tuple[str, ...] = ENDINGS) -> None:
    """Check that a picture can be written to a file of that ending; InputError names the endings."""
    if path.suffix[1:].lower() not in endings:
        allowed = ", ".join(f".{ending}" for ending in endings)
        raise InputError(
            f"{path}: unknown kind of picture '{path.suffix}', give {'one of ' * (len(endings) > 1)}{allowed}"
        )


def save_picture(figure: "Figure", path: Path) -> Path:
    """Write a figure in the chosen theme and return its path. Errors as check_picture and write_bytes."""
    import matplotlib as mpl

    check_picture(path)
    ending, drawn = path.suffix[1:].lower(), io.BytesIO()
    with mpl.rc_context(_KEPT):
        figure.savefig(drawn, format=ending, metadata=_UNDATED.get(ending), **apply_theme(figure))
    write_bytes(path, drawn.getvalue())
    return path
