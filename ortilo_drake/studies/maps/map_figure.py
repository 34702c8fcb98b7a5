"""The picture of a map: heat maps over two axes, or curves over one."""

import math
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import PercentFormatter

from ortilo_drake.scenario.schema import scenario_keys
from ortilo_drake.sensors.described import BUILT_IN, title_of
from ortilo_drake.studies.maps.map_flights import Map
from ortilo_drake.studies.maps.map_report import MapTheory
from ortilo_drake.studies.maps.sweep import Grid, Range
from ortilo_drake.views.palette import BLUE, ORANGE
from ortilo_drake.views.pictures import figure_to
from ortilo_drake.views.themes import add_title

BOUND = "theory: bound on the mean,\napproximate, near hover"
LINK_NAMES = {
    "rate": "{} rate",
    "delay": "{} delay",
    "random_delay": "largest additional {} delay",
    "loss": "share of {} messages lost",
    "loss.probability": "share of {} messages lost",
    "loss.loss": "share of {} messages lost",
    "loss.mean_length": "mean burst of lost {} messages",
}
LOST = "flights lost [%]"
THEORY = "magenta"  # stands out of both maps' colours
_REDDEST = 0.5  # the colour scale of lost flights ends at this share at least
_SHORTEST = 2.0  # shorter lines are not drawn [cells]; on a small map, shorter than this share of its side
_SHARE = 0.75
_ROUND = (1.0, 2.0, 5.0)  # first digits of round levels
_LESS_ROUND = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
_FEWEST = 2  # with fewer round levels shared by flights and theory, less round ones are used


def map_figure(found: Map, path: File, theory: MapTheory | None = None) -> File | None:
    """Draw the share of lost flights and the kept flights' median RMS error, with theory's lines over them, if any.

    Return None unless the map is a grid of one or two axes. InputError if the picture cannot be written.
    """
    axes = found.sweep.axes
    if not isinstance(found.sweep.design, Grid) or len(axes) > 2:
        return None
    with figure_to(path, (9.5, 3.8)) as figure:
        some_lost = any(row.lost for row in found.rows)
        panels = figure.subplots(1, 1 + some_lost, squeeze=False)[0]
        if len(axes) == 1:
            _curves(panels, found, theory)
        else:
            _heat(figure, panels, found, theory)
        add_title(figure, _heading(found), "" if some_lost else _none_lost(found))
    return path


def _values(found: Map, key: str) -> list[Any]:
    return list(dict.fromkeys(row.point[key] for row in found.rows))


def _title(key: str, numbers: bool) -> str:
    """Return a setting's plain name for an axis, with the unit if its values are numbers."""
    unit = next((its.unit for its in scenario_keys(key) if its.key == key), "")
    group, _, of_link = key.partition(".link.")
    if of_link in LINK_NAMES:
        name = LINK_NAMES[of_link].format(title_of(group))
    else:
        first, _, rest = key.replace("_", " ").partition(".")
        name = f"{title_of(first) if first in BUILT_IN else first} {rest.replace('.', ' ')}".rstrip()
    return f"{name} [{'-' if unit in ('', '1') else unit}]" if numbers else name


def _heading(found: Map) -> str:
    fewest, most = min(row.flights for row in found.rows), max(row.flights for row in found.rows)
    name = found.sweep.scenario
    name = File(name).stem if name.endswith((".yaml", ".yml")) else name
    return f"{name}: {fewest if fewest == most else f'{fewest} to {most}'} flights at each point"


def _none_lost(found: Map) -> str:
    flights = sum(row.flights for row in found.rows)
    highest = max(row.lost_high for row in found.rows)
    return f"None of the {flights:,} flights was lost: at each point at most {100.0 * highest:.2g} % are lost (95 %)."


def _legend_above(panel: Any) -> None:
    panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=7, frameon=False)


def _curves(panels: Any, found: Map, theory: MapTheory | None) -> None:
    (key,) = found.sweep.axes
    values, rows = _values(found, key), found.rows
    numbers = _are_numbers(values)
    x = values if numbers else range(len(values))
    if len(panels) > 1:
        low, high = (np.array([getattr(row, f"lost_{end}") for row in rows]) for end in ("low", "high"))
        panels[0].fill_between(x, low, high, color=ORANGE, alpha=0.2, lw=0, label="95 % interval")
        panels[0].plot(
            x, [row.lost / row.flights for row in rows], "o-", color=ORANGE, label="of the flights flown", clip_on=False
        )
        if theory is not None and theory.lost is not None:
            panels[0].plot(x, theory.lost, "--", color="k", lw=1.0, label=_law(theory))
        panels[0].set(ylabel=LOST, ylim=(0.0, min(1.0, 1.1 * high.max())))
        panels[0].yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
        _legend_above(panels[0])
    kept = panels[-1]
    rms = np.array([[np.nan if v is None else v for v in (row.rms_low, row.kept_rms, row.rms_high)] for row in rows])
    ends = np.array([row.kept_interval or (np.nan, np.nan) for row in rows])
    bars = np.abs(ends - rms[:, 1:2]).T
    kept.fill_between(x, rms[:, 0], rms[:, 2], color=BLUE, alpha=0.2, lw=0, label="middle half of the kept")
    kept.errorbar(x, rms[:, 1], bars, fmt="o-", color=BLUE, capsize=2, label="median of the kept,\n95 % interval")
    if theory is not None and np.isfinite(theory.rms).any():
        kept.plot(x, np.where(np.isfinite(theory.rms), theory.rms, np.nan), "--", color="k", lw=1.0, label=BOUND)
    kept.set(ylabel="RMS error [m]", ylim=(0.0, None))
    _legend_above(kept)
    axis = found.sweep.axes[key]
    for panel in panels:
        panel.set_xlabel(_title(key, numbers))
        if not numbers:
            panel.set_xticks(x, [str(v) for v in values])
        elif isinstance(axis, Range) and axis.scale == "log":
            panel.set_xscale("log")


def _heat(figure: Figure, panels: Any, found: Map, theory: MapTheory | None) -> None:
    first, second = found.sweep.axes
    (rows, row_order), (columns, column_order) = (_rising(_values(found, key)) for key in (first, second))

    def in_order(values: Any) -> np.ndarray:
        cells = np.asarray(values, dtype=float).reshape(len(rows), len(columns))
        return np.asarray(cells[np.ix_(row_order, column_order)])

    def cells(figure_of: Any) -> np.ndarray:
        return in_order([figure_of(row) for row in found.rows])

    lost = cells(lambda row: row.lost / row.flights)
    rms = cells(lambda row: np.nan if row.kept_rms is None else row.kept_rms)
    finite = rms[np.isfinite(rms)]
    spread = LogNorm(finite.min(), max(finite.max(), 1.01 * finite.min())) if finite.size else Normalize()
    label = "median RMS error [m]" + ("" if len(finite) == rms.size else "; white: all lost")
    drawn = (
        (panels[0], lost, Normalize(0.0, max(lost.max(), _REDDEST)), "YlOrRd", LOST),
        (panels[-1], rms, spread, "viridis", label),
    )
    for panel, values, norm, colors, label in drawn[-len(panels) :]:
        image = panel.imshow(values, origin="lower", aspect="auto", cmap=colors, norm=norm)
        panel.set(xlabel=_title(second, _are_numbers(columns)), ylabel=_title(first, _are_numbers(rows)))
        panel.set_xticks(*_ticks(columns))
        panel.set_yticks(*_ticks(rows))
        panel.tick_params(length=0)
        panel.spines[:].set_visible(False)
        bar = figure.colorbar(image, ax=panel, label=label)
        if label == LOST:
            bar.formatter = PercentFormatter(1.0, symbol="")
        if isinstance(norm, LogNorm):
            round_ticks = _round_levels(finite.min(), finite.max(), (1.0, 2.0, 3.0, 5.0))
            if len(round_ticks) > 1:
                bar.set_ticks(round_ticks, labels=[f"{tick:g}" for tick in round_ticks])
                bar.minorticks_off()
    percent = {0.05: "5 %", 0.5: "50 %"}
    metres = _levels(rms, rms if theory is None else theory.rms)
    _contours(panels[-1], rms, metres, "equal error of the flights kept")
    if theory is not None:
        _contours(panels[-1], in_order(theory.rms), metres, BOUND, THEORY)
    if len(panels) > 1:
        _contours(panels[0], lost, percent, "equal share lost of the flights flown")
        if theory is not None and theory.lost is not None:
            _contours(panels[0], in_order(theory.lost), percent, _law(theory), THEORY)


def _levels(flown: np.ndarray, theory: np.ndarray) -> dict[float, str]:
    """Return round errors [m] for the lines of both, with their names; less round ones if both share few."""
    known = [values[np.isfinite(values)] for values in (flown, theory)]
    if not known[0].size:
        return {}
    ends = [(values.min(), values.max()) for values in known if values.size]
    shared = max(low for low, _ in ends), min(high for _, high in ends)
    few = shared[0] >= shared[1] or len(_round_levels(*shared, _ROUND)) < _FEWEST
    digits = _LESS_ROUND if few else _ROUND
    levels = {level for low, high in ends for level in _round_levels(low, high, digits)}
    return {level: f"{level:g} m" for level in levels}


def _contours(panel: Any, values: np.ndarray, names: dict[float, str], said: str, color: str = "k") -> None:
    """Draw the lines of these levels, with a halo that sets them off from the map; nothing if there are none."""
    shown = np.ma.masked_invalid(values)
    levels = sorted(level for level in names if shown.count() and shown.min() < level < shown.max())
    if not levels or min(values.shape) < 2:
        return
    width, dashes = (1.6, "--") if color == THEORY else (0.8, "-")
    lines = panel.contour(shown, levels=levels, colors=color, linewidths=width, linestyles=dashes)
    least = min(_SHORTEST, _SHARE * (min(values.shape) - 1))
    long = [[Path(line) for line in at if np.hypot(*np.diff(line, axis=0).T).sum() >= least] for at in lines.allsegs]
    if not any(long):
        lines.remove()
        return
    lines.set_paths([Path.make_compound_path(*paths) for paths in long])
    lines.set_path_effects([withStroke(linewidth=width + 1.6, foreground="white", alpha=0.7)])
    at = [_along(paths, 0.7 if color == THEORY else 0.3) for paths in long if paths]  # labels of a level lie apart
    for text in panel.clabel(lines, fmt=names, fontsize=8, inline_spacing=2, manual=at):
        text.set_path_effects([withStroke(linewidth=2.5, foreground="white", alpha=0.9)])
    panel.plot([], [], dashes, color=color, lw=width, label=said)
    _legend_above(panel)


def _along(paths: list[Path], share: float) -> tuple[float, float]:
    """Return the point (x, y) at a share of the length of the longest of these lines."""
    lines = [np.asarray(path.vertices) for path in paths]
    ways = [np.r_[0.0, np.hypot(*np.diff(line, axis=0).T).cumsum()] for line in lines]
    line, way = max(zip(lines, ways, strict=True), key=lambda both: both[1][-1])
    x, y = (float(np.interp(share * way[-1], way, line[:, k])) for k in (0, 1))
    return x, y


def _law(theory: MapTheory) -> str:
    return f"theory: a burst longer than {theory.longest:.3g} s (fitted)"


def _are_numbers(values: list[Any]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def _rising(values: list[Any]) -> tuple[list[Any], list[int]]:
    """Return numbers in ascending order, with the place of each before; other values as they are."""
    order = sorted(range(len(values)), key=values.__getitem__) if _are_numbers(values) else list(range(len(values)))
    return [values[k] for k in order], order


def _round_levels(low: float, high: float, digits: tuple[float, ...]) -> list[float]:
    """Return the numbers between low and high that consist of one of these digits and a power of ten."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [float(f"{d:g}e{k}") for k in powers for d in digits if low < float(f"{d:g}e{k}") < high]


def _ticks(values: list[Any]) -> tuple[list[int], list[str]]:
    at = list(range(len(values) - 1, -1, -max(1, len(values) // 6)))[::-1]
    return at, [f"{v:.3g}" if isinstance(v, float) else str(v) for v in (values[i] for i in at)]
