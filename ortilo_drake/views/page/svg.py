"""The SVG drawings of a flight's page: errors in 3-sigma bands, arrivals, the room from above."""

from html import escape
from typing import Any

import numpy as np

from ortilo_drake.model.room import Room
from ortilo_drake.views.figures import turned
from ortilo_drake.views.page.flight_data import sensor_color
from ortilo_drake.world.scenery.meshcat_replay import Zone

WIDTH, HEIGHT = 1000.0, 100.0  # size of a plot over time, which the page stretches to its width


def points(columns: np.ndarray) -> str:
    """Return points (n x 2) in SVG's notation."""
    return " ".join(f"{x:.4g},{y:.4g}" for x, y in columns)


def round_up(length: float) -> float:
    """Return a length rounded up to half of its first digit's unit, such as 0.035 for 0.031."""
    step = 10.0 ** np.floor(np.log10(length)) / 2.0
    return float(f"{np.ceil(length / step) * step:.2g}")


def error_plot(data: dict[str, Any], axis: int) -> str:
    """Return the plot of the error on one axis in its 3-sigma band."""
    time, error = np.array(data["time"]), np.array(data["error"])[:, axis]
    band = 3 * np.array(data["sigma"])[:, axis]
    limit = round_up(max(1e-3, float(max(np.quantile(band, 0.99), np.max(np.abs(error))))))
    x = across(data, time)

    def y(values: np.ndarray) -> np.ndarray:
        return HEIGHT / 2 * (1 - np.clip(values / limit, -1, 1))

    outline = np.vstack([np.column_stack([x, y(band)]), np.column_stack([x, y(-band)])[::-1]])
    name = "xyz"[axis]
    drawn = (
        f'<polygon class="band" points="{points(outline)}"/><path class="zero" d="M0 50H1000"/>'
        f'<polyline class="error" points="{points(np.column_stack([x, y(error)]))}"/>'
    )
    label = f"error {name}"
    return _plot(label, f"{label} [m]", (f"+{limit:.2g}", f"−{limit:.2g}"), shades(data, None) + drawn)


def arrival_plot(data: dict[str, Any], sensor: dict[str, Any]) -> str:
    """Return the plot of one sensor's arrivals: a mark for each used fix, a faint mark for each missing one."""
    marks = "".join(
        f'<path class="{kind}" stroke="{sensor_color(sensor["name"]) if kind == "used" else "#b5bac2"}" d="'
        + "".join(f"M{x:.5g} {top}V{bottom}" for x in across(data, np.array(sensor[of])))
        + '"/>'
        for kind, of, top, bottom in (("due", "missing", 60, 90), ("used", "arrivals", 10, 90))
    )
    return _plot(f"arrivals of {sensor['name']}", sensor["name"], None, shades(data, sensor["name"]) + marks, "low")


def time_ticks(data: dict[str, Any]) -> str:
    """Return the ticks below a plot over time, at round times [s]."""
    from matplotlib.ticker import MaxNLocator

    times = np.array(MaxNLocator(9, steps=[1, 2, 5, 10]).tick_values(data["time"][0], data["time"][-1]))
    shown = [(time, x) for time, x in zip(times, across(data, times), strict=True) if 0.0 <= x <= WIDTH]
    return "".join(f'<span style="left:{x / WIDTH:.2%}">{time:g}</span>' for time, x in shown)


def shades(data: dict[str, Any], only: str | None) -> str:
    """Return the blackouts of one sensor, or of all, as strips over time."""
    return "".join(
        f'<rect class="shade" x="{a:.5g}" width="{b - a:.5g}" y="0" height="100" fill="{sensor_color(s["name"])}"/>'
        for s in data["sensors"]
        if only in (None, s["name"])
        for a, b in across(data, np.array(s["blackouts"]))
    )


def across(data: dict[str, Any], time: np.ndarray) -> np.ndarray:
    """Return the x coordinates of times [s] in a plot over time (n)."""
    start, end = data["time"][0], data["time"][-1]
    return WIDTH * (time - start) / max(end - start, 1e-9)


def _plot(label: str, title: str, limits: tuple[str, str] | None, drawn: str, kind: str = "") -> str:
    ends = f"<b>{limits[0]}</b><b>{limits[1]}</b>" if limits else ""
    return (
        f'<div class="plot {kind}"><div class="name">{escape(title)}</div><div class="ends">{ends}</div>'
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none" role="img" aria-label="{escape(label)}">'
        f'{drawn}<path class="cursor" d="M0 0V100"/></svg></div>'
    )


def plan_svg(room: Room, zones: list[Zone], reference: np.ndarray, data: dict[str, Any]) -> str:
    """Return the room from above, north up, with planned, true and estimated path and two moving markers.

    `zones` are the places where a sensor is blacked out, `reference` the planned positions in W (n x 3) [m], `data`
    comes from flight_data.
    """
    (x0, y0), (x1, y1) = room.interior.min[:2], room.interior.max[:2]
    parts = [f'<rect class="floor" x="{x0}" y="{y0}" width="{x1 - x0}" height="{y1 - y0}"/>']
    for zone in zones:
        color = ",".join(f"{255 * c:.0f}" for c in zone.color)
        size = np.subtract(zone.high, zone.low)
        parts.append(
            f'<rect class="zone" x="{zone.low[0]}" y="{zone.low[1]}" width="{size[0]:.4g}" height="{size[1]:.4g}" '
            f'fill="rgb({color})"/>'
        )
    for x, y, _, yaw, half_x, half_y, _ in room.wall_boxes:
        corners = turned(np.array([x, y]), yaw, np.array([half_x, half_y]))
        parts.append(f'<polygon class="wall" points="{points(corners)}"/>')
    parts += [f'<circle class="stand" cx="{x}" cy="{y}" r="{r}"/>' for x, y, r, _ in room.stand_cylinders]
    parts += [f'<circle class="landmark" cx="{p[0]}" cy="{p[1]}" r="0.09"/>' for p in room.landmark_positions]
    parts += [f'<circle class="anchor" cx="{p[0]}" cy="{p[1]}" r="0.13"/>' for p in room.anchor_positions]
    paths = {"planned": reference, "truth": np.array(data["truth"]), "estimate": np.array(data["estimate"])}
    parts += [f'<polyline class="path {name}" points="{points(p[:, :2])}"/>' for name, p in paths.items()]
    parts += ['<circle id="at-truth" r="0.2"/>', '<circle id="at-estimate" r="0.3"/>']
    box = f"{x0 - 0.5} {-y1 - 0.5} {x1 - x0 + 1} {y1 - y0 + 1}"
    return (
        f'<svg id="plan" viewBox="{box}" role="img" aria-label="the room from above">'
        f'<g transform="scale(1,-1)">{"".join(parts)}</g></svg>'
    )
