"""The themes of figures that are written to files: light, dark, for slides or for print.

A theme is applied to the finished figure, so the functions that draw need not know the theme.
"""

import colorsys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any, Final

from ortilo_drake.model.input_error import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLIDE_SIZE: Final = (9.6, 5.4)  # size of a slide [in]: 16:9, and small, so that text of a page's size looks large
SLIDE_DPI: Final = 200  # resolution of a slide: 1920 x 1080 pixels
SLIDE_TEXT: Final = 7.2  # smallest font size on a slide [pt], 20 pixels
PRINTED: Final = 300  # resolution of print [dpi]
_NEUTRAL: Final = 0.15  # a colour whose red, green and blue differ by less counts as grey
_CAPTION: Final = 8.0  # size of a caption [pt]
_TITLE: Final = 12.0  # size of a title that the user chose [pt]
_LETTER: Final = 0.54  # mean width of a letter over its font size
_DARKEST: Final = 0.5  # least lightness of a colour on a dark background
_GROUND: Final = 0.07  # lightness of the dark background


class Theme(StrEnum):
    """The themes of figures."""

    light = "light"
    dark = "dark"
    slides = "slides"
    print = "print"


_chosen: ContextVar[Theme] = ContextVar("theme", default=Theme.light)
_title: ContextVar[str] = ContextVar("title", default="")


@contextmanager
def themed(theme: Theme, title: str = "") -> Iterator[None]:
    """Write every figure in a theme, and under a title if there is one, until the block ends."""
    before, titled = _chosen.set(theme), _title.set(title)
    try:
        yield
    finally:
        _chosen.reset(before)
        _title.reset(titled)


def for_slides() -> bool:
    """Return whether figures are for slides; these are 16:9, and some figures arrange their panels differently."""
    return _chosen.get() is Theme.slides


def add_title(figure: "Figure", title: str, caption: str = "") -> None:
    """Give a figure a title of one line, and at the bottom a caption in lines of about the same length."""
    width = (SLIDE_SIZE if for_slides() else figure.get_size_inches())[0]
    figure.suptitle(title, fontsize=10)
    if caption:
        figure.supxlabel(balanced(caption, int(0.96 * width * 72.0 / (_LETTER * _CAPTION))), fontsize=_CAPTION)


def balanced(text: str, most: int) -> str:
    """Break a text into the fewest lines of at most `most` letters, and make the longest line as short as possible."""
    lines = len(wrap(text, most))
    return next(fill(text, width) for width in range(1, most + 1) if len(wrap(text, width)) <= lines)


def apply_theme(figure: "Figure") -> dict[str, Any]:
    """Give a figure the chosen theme and title; return the keyword arguments for savefig."""
    theme = _chosen.get()
    if title := _title.get():
        width = (SLIDE_SIZE if for_slides() else figure.get_size_inches())[0]
        lines = balanced(title, int(0.9 * width * 72.0 / (_LETTER * _TITLE)))
        figure.suptitle(lines, fontsize=_TITLE, parse_math=False)
    if theme is Theme.dark:
        _darken(figure)
    elif theme is Theme.slides:
        figure.set_size_inches(*SLIDE_SIZE)
        _enlarge_words(figure)
        _wrap_labels(figure)
        return {"dpi": SLIDE_DPI}
    elif theme is Theme.print:
        return {"dpi": PRINTED}
    return {"dpi": "figure"}


def in_theme(draw: Callable[[], "Figure"], name: str) -> "Figure":
    """Return a figure drawn in the theme of this name, as savefig and notebooks show it.

    InputError if there is no such theme.
    """
    if name not in list(Theme):
        raise InputError(f"theme: {name!r}: must be one of {', '.join(Theme)}")
    with themed(Theme(name)):
        figure = draw()
        dpi = apply_theme(figure)["dpi"]
    if dpi != "figure":
        figure.set_dpi(dpi)
    return figure


def _enlarge_words(figure: "Figure") -> None:
    """Enlarge all text of a figure to at least SLIDE_TEXT."""
    from matplotlib.text import Text

    for axes in figure.axes:  # also the ticks that matplotlib makes when it draws the figure
        for name in ("x", "y"):
            ticks = getattr(axes, f"get_{name}ticklabels")()
            if ticks and ticks[0].get_fontsize() < SLIDE_TEXT:
                axes.tick_params(axis=name, which="both", labelsize=SLIDE_TEXT)
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), SLIDE_TEXT))


def _wrap_labels(figure: "Figure") -> None:
    """Break labels that are longer than their axes: they would be cut off, or run into the labels of the next axes."""
    figure.draw_without_rendering()
    for axes in figure.axes:
        for label, side in ((axes.xaxis.label, "width"), (axes.yaxis.label, "height")):
            share = getattr(axes.bbox, side) / max(getattr(label.get_window_extent(), side), 1.0)
            if share < 1.0:
                widest = max(map(len, label.get_text().splitlines()))
                label.set_text(fill(label.get_text(), max(int(0.9 * share * widest), 1), break_long_words=False))


def broken_name(name: str, most: int) -> str:
    """Break a name after underscores into lines of about the same length, of at most `most` letters."""
    if len(name) <= most:
        return name
    return balanced(name.replace("_", "_ "), max(most, *map(len, name.split("_")))).replace("_ ", "_")


def dark(color: Any) -> Any:
    """Return the RGBA colour for a dark background: greys are inverted, dark colours become lighter."""
    from matplotlib.colors import to_rgba

    *rgb, alpha = to_rgba(color)
    hue, light, strength = colorsys.rgb_to_hls(*rgb)
    if max(rgb) - min(rgb) < _NEUTRAL:
        return (*3 * [_GROUND + (1.0 - _GROUND) * (1.0 - light)], alpha)
    return (*colorsys.hls_to_rgb(hue, max(light, _DARKEST), strength), alpha)


def _darken(figure: "Figure") -> None:
    """Give every line, face and text of a figure its colour for a dark background.

    Maps, pictures and the text on them keep their colours.
    """
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection, QuadMesh
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    on_maps = {
        id(text)
        for axes in figure.findobj(Axes)
        if axes.images or any(isinstance(item, QuadMesh) for item in axes.collections)
        for text in axes.texts
    }
    for artist in figure.findobj():
        if isinstance(artist, Text) and id(artist) not in on_maps:
            _darken_words(artist)
        elif isinstance(artist, Line2D):
            for name in ("color", "markeredgecolor", "markerfacecolor", "markerfacecoloralt"):
                color = getattr(artist, f"get_{name}")()
                if not (isinstance(color, str) and color == "none"):
                    artist.set(**{name: dark(color)})
        elif isinstance(artist, Patch):
            artist.set(facecolor=dark(artist.get_facecolor()), edgecolor=dark(artist.get_edgecolor()))
        elif isinstance(artist, Collection) and artist.get_array() is None:
            faces, edges = artist.get_facecolor(), artist.get_edgecolor()
            artist.set(facecolor=[dark(color) for color in faces], edgecolor=[dark(color) for color in edges])
    for axes in figure.findobj(Axes):  # also the ticks that matplotlib makes when it draws the figure
        axes.tick_params(which="both", colors=dark("black"))


def _darken_words(text: Any) -> None:
    """Give a text, its box, its arrow and its halo their colours for a dark background."""
    from matplotlib.patheffects import withStroke

    text.set_color(dark(text.get_color()))
    for patch in (text.get_bbox_patch(), getattr(text, "arrow_patch", None)):
        if patch is not None:
            patch.set(facecolor=dark(patch.get_facecolor()), edgecolor=dark(patch.get_edgecolor()))
    if text.get_path_effects():
        text.set_path_effects([withStroke(linewidth=2.2, foreground=dark("white"), alpha=0.85)])
