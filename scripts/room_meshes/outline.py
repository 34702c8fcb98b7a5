"""Reduce a mesh to the few points of its convex hull that decide how large it looks, and note them in the room."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

POINTS = 24
BEGIN = "# landmark_outline: made by scripts/make_room_meshes.py, begin"
END = "# landmark_outline: made by scripts/make_room_meshes.py, end"
NOTE = (
    "# Points of each class's convex hull in its own axes (x forward, y left, z up), in half extents about the centre."
)


def directions(count: int = 4000) -> np.ndarray:
    """Return unit vectors evenly over the sphere (n, 3), the axes among them: a Fibonacci spiral."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    angle = np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    return np.vstack([np.eye(3), -np.eye(3), np.column_stack([r * np.cos(angle), r * np.sin(angle), z])])


def outline(points: np.ndarray, count: int = POINTS) -> np.ndarray:
    """Return the support points of the mesh that keep the worst shortfall small (count, 3) [m].

    Start with the six points of the bounding box, add the support point of the worst direction until there are
    enough, then exchange single points for as long as that lowers the shortfalls' fourth powers or the worst.
    A shortfall is what the chosen points lack of the mesh's support in a direction, as a share of its width there.
    """
    along = directions()
    points = points[np.argsort(-np.linalg.norm(points, axis=1), kind="stable")]  # of equals the outermost
    candidates = points[np.unique(np.round(points @ along.T, 5).argmax(axis=0))]
    candidates = candidates[np.argsort(-np.linalg.norm(candidates, axis=1), kind="stable")]
    reach = np.round(candidates @ along.T, 5)
    full, width = reach.max(axis=0), reach.max(axis=0) - reach.min(axis=0)
    share = (full - reach) / width  # (candidates, directions): shortfall if that point were alone
    picked = list(dict.fromkeys(int(k) for k in share[:, :6].argmin(axis=0)))
    fixed = len(picked)
    while len(picked) < min(count, len(candidates)):
        worst = share[picked].min(axis=0).argmax()
        picked.append(int(share[:, worst].argmin()))
    starts = [_exchanged(share, picked, fixed, norm) for norm in (_largest, _fourth_powers)]
    starts.append(_exchanged(share, starts[1], fixed, _largest))
    picked = min(starts, key=lambda rows: share[rows].min(axis=0).max())
    picked += [picked[-1]] * (count - len(picked))
    return candidates[picked]


def _largest(shortfalls: np.ndarray) -> np.ndarray:
    return shortfalls.max(axis=1)


def _fourth_powers(shortfalls: np.ndarray) -> np.ndarray:
    return (shortfalls**4).sum(axis=1)


def _exchanged(share: np.ndarray, picked: list[int], fixed: int, norm: Callable[[np.ndarray], np.ndarray]) -> list[int]:
    """Return the picked rows after the exchanges that lower the norm of the shortfalls, the first ones fixed."""
    picked, best, improved = list(picked), np.inf, True
    while improved:
        improved = False
        for i in range(fixed, len(picked)):
            rest = share[picked[:i] + picked[i + 1 :]].min(axis=0)
            totals = norm(np.minimum(share, rest))
            k = int(totals.argmin())
            if totals[k] < best * (1.0 - 1e-6):
                picked[i], best, improved = k, float(totals[k]), True
    return picked


def drawn_in(points: np.ndarray, chosen: np.ndarray, slack: float = 0.003) -> np.ndarray:
    """Return the mesh's vertices (n, 3), those that stick out of the outline drawn in until it tells the mesh's size.

    Each vertex goes to a nearest place at which no support exceeds the outline's by more than the slack, a share of
    the width: successive projections on the half spaces of all directions. The outline's own points stay.
    """
    along = directions(12000)  # finely: a vertex can slip out between two of them
    reach = points @ along.T
    limit = (chosen @ along.T).max(axis=0) + slack * (reach.max(axis=0) - reach.min(axis=0))
    points, out = points.copy(), np.arange(len(points))
    for _ in range(200):
        excess = points[out] @ along.T - limit
        worst = excess.argmax(axis=1)
        beyond = excess[np.arange(len(out)), worst]
        out, worst, beyond = out[beyond > 1e-6], worst[beyond > 1e-6], beyond[beyond > 1e-6]
        if len(out) == 0:
            break
        points[out] -= beyond[:, None] * along[worst]
    return points


def section(outlines: dict[str, np.ndarray]) -> str:
    """Return the room file's lines for outlines in half extents, by class."""
    rows = []
    for label, points in outlines.items():
        triples = (", ".join(f"{v:.3f}" for v in np.round(p, 3) + 0.0) for p in points)
        rows.append(f"  {label}: [{', '.join(f'[{triple}]' for triple in triples)}]")
    return "\n".join([BEGIN, NOTE, "landmark_outline:", *rows, END, ""])


def write_section(room: Path, text: str) -> None:
    """Put the section in its place in the room file, or before the camera's comment; in one step."""
    old = room.read_text(encoding="utf-8")
    if BEGIN in old:
        before, rest = old.split(BEGIN, 1)
        new = before + text + rest.split(END + "\n", 1)[1]
    else:
        at = old.index("# The camera on the vehicle")
        new = old[:at] + text + "\n" + old[at:]
    if new != old:
        beside = room.with_suffix(".tmp")
        beside.write_text(new, encoding="utf-8", newline="\n")
        os.replace(beside, room)
