"""The room in a flight's figure shows what the vehicle may touch."""

import numpy as np
from matplotlib.figure import Figure

from ortilo_drake.model.room import Interior, Room
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.figures import _runs, draw_room


def test_furniture_is_drawn_where_it_stands() -> None:
    """A box of 2 x 1 m turned by 90 degrees about (3, 2) is 1 m wide and 2 m deep."""
    room = Room(
        interior=Interior(min=(0.0, 0.0, 0.0), max=(8.0, 6.0, 3.0)),
        anchors=((0.0, 0.0, 1.0), (8.0, 0.0, 2.0), (8.0, 6.0, 1.0), (0.0, 6.0, 2.0)),
        furniture=(("box", 3.0, 2.0, 0.0, 0.0, 0.0, np.pi / 2),),
        furniture_size={"box": (2.0, 1.0, 1.0)},
        walls=(), stands=(), landmarks=(),
    )  # fmt: skip
    axes = Figure().add_subplot()
    draw_room(axes, room, load_scenario("imu_uwb", "uwb.link.blackouts=[]"))
    (patch,) = axes.patches
    corners = np.asarray(patch.get_path().vertices, dtype=float)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[2.5, 1.0], [3.5, 3.0]], atol=1e-12)


def test_arrivals_are_a_bar_for_each_run_of_used_values() -> None:
    """Ten due values a second; the third and the last two are missing."""
    time = np.arange(0.0, 1.0, 1.0 / 30.0)
    due = np.arange(30) % 3 == 0
    used = due.copy()
    used[[6, 24, 27]] = False
    np.testing.assert_allclose(_runs(time, due, used), [(0.0, 0.2), (0.3, 0.5)], atol=1e-12)
    np.testing.assert_allclose(_runs(time, due, due & ~used), [(0.2, 0.1), (0.8, 0.2)], atol=1e-12)
    assert _runs(time, due, np.zeros(30, bool)) == []
