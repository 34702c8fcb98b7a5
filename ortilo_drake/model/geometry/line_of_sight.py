"""Lines of sight through the room: the obstacles between two points, for radio and camera.

Obstacles are the arrays of model/room.py: boxes turned about the vertical, with rows (x, y, z of the centre, yaw, three
half sizes), and vertical cylinders on the floor z = 0, with rows (x, y, radius, height) [m].

The line from p to q is p + t d, d = q - p, 0 <= t <= 1. Each obstacle is an intersection of convex sets, so the line is
inside for one interval of t, the intersection of the intervals of these sets: three slabs in the box's own frame (Kay
and Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986), or a circle in plan and a slab in height. An obstacle blocks
the line if this interval is longer than 0 and neither p nor q is inside the obstacle: an anchor that is mounted in a
wall is visible.
"""

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import sin_cos


@cached_njit
def _slab(o: float, d: float, half: float, t_in: float, t_out: float) -> tuple[float, float]:
    """Return the part of the interval [t_in, t_out] with |o + t d| <= half; t_in > t_out if this part is empty."""
    if d == 0.0:
        return (t_in, t_out) if abs(o) <= half else (1.0, 0.0)
    t1, t2 = (-half - o) / d, (half - o) / d
    return max(t_in, min(t1, t2)), min(t_out, max(t1, t2))


@cached_njit
def _outside_and_through(t_in: float, t_out: float) -> bool:
    """Return whether the line is inside for some t in (t_in, t_out), and outside at both ends t = 0 and t = 1."""
    return 0.0 < t_in < t_out < 1.0


@cached_njit(error_model="numpy", _nrt=False)
def crosses_box(p: np.ndarray, q: np.ndarray, box: np.ndarray) -> bool:
    """Return whether the line from p to q (3, in W) goes through a box (7) that contains neither end."""
    x, y = p[0] - box[0], p[1] - box[1]
    dx, dy = q[0] - p[0], q[1] - p[1]
    # The line misses most boxes: in plan it passes outside the circle around the box. These boxes need no sine.
    if (x * dy - y * dx) ** 2 > (box[4] ** 2 + box[5] ** 2) * (dx**2 + dy**2):
        return False
    s, c = sin_cos(box[3])
    t_in, t_out = _slab(c * x + s * y, c * dx + s * dy, box[4], -np.inf, np.inf)
    t_in, t_out = _slab(c * y - s * x, c * dy - s * dx, box[5], t_in, t_out)
    t_in, t_out = _slab(p[2] - box[2], q[2] - p[2], box[6], t_in, t_out)
    return _outside_and_through(t_in, t_out)


@cached_njit(error_model="numpy", _nrt=False)
def crosses_cylinder(p: np.ndarray, q: np.ndarray, cylinder: np.ndarray) -> bool:
    """Return whether the line from p to q (3, in W) goes through a cylinder (4) that contains neither end."""
    x, y = p[0] - cylinder[0], p[1] - cylinder[1]
    dx, dy = q[0] - p[0], q[1] - p[1]
    # In plan: |(x, y) + t (dx, dy)|^2 <= r^2, that is a t^2 + 2 b t + c <= 0.
    a, b, c = dx**2 + dy**2, x * dx + y * dy, x**2 + y**2 - cylinder[2] ** 2
    t_in, t_out = -np.inf, np.inf
    if a > 0.0:
        discriminant = b**2 - a * c
        if discriminant <= 0.0:
            return False
        root = np.sqrt(discriminant)
        t_in, t_out = (-b - root) / a, (-b + root) / a
    elif c > 0.0:
        return False
    half = cylinder[3] / 2.0
    t_in, t_out = _slab(p[2] - half, q[2] - p[2], half, t_in, t_out)
    return _outside_and_through(t_in, t_out)


@cached_njit(error_model="numpy", _nrt=False)
def walls_crossed(p: np.ndarray, q: np.ndarray, boxes: np.ndarray) -> int:
    """Return the number of boxes (n, 7) through which the line from p to q (3, in W) goes.

    A box that contains p or q does not count.
    """
    count = 0
    for i in range(boxes.shape[0]):
        if crosses_box(p, q, boxes[i]):
            count += 1
    return count


@cached_njit
def is_hidden(p: np.ndarray, q: np.ndarray, boxes: np.ndarray, cylinders: np.ndarray) -> bool:
    """Return whether a box (n, 7) or a cylinder (m, 4) is between p and q (3, in W).

    An obstacle that contains p or q does not count.
    """
    for i in range(boxes.shape[0]):
        if crosses_box(p, q, boxes[i]):
            return True
    for i in range(cylinders.shape[0]):  # noqa: SIM110 - numba compiles no generator expression in any()
        if crosses_cylinder(p, q, cylinders[i]):
            return True
    return False
