"""The room in a flight's figure shows what the vehicle may touch."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.room import Interior, Room
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.figures import draw_arrivals, draw_flight, draw_paths, draw_room


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
    patch, outer = axes.patches
    corners = np.asarray(patch.get_path().vertices, dtype=float)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[2.5, 1.0], [3.5, 3.0]], atol=1e-12)
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    np.testing.assert_allclose(outer.get_extents().get_points(), axes.transData.transform([low, high]))


def test_a_legend_names_each_thing_in_the_room_once_and_nothing_is_written_on_a_wall() -> None:
    scenario = load_scenario("imu_uwb")
    axes = Figure().add_subplot()
    draw_room(axes, scenario.load_room(), scenario)
    named = axes.get_legend_handles_labels()[1]
    assert sorted(named) == ["anchor", "furniture", "landmark", "no UWB", "outer wall", "stand", "wall"]
    assert not axes.texts


def test_paths_on_each_other_are_all_seen() -> None:
    """From below to above each line is less than half as wide as the one below it, or broken."""
    path = (("tick", "axis"), np.zeros((5, 3)))
    axes = Figure().add_subplot()
    draw_paths(axes, xr.Dataset(dict.fromkeys(("reference", "truth", "estimate"), path)))
    true, estimated, planned = axes.get_lines()
    assert [line.get_label() for line in (true, estimated, planned)] == ["true", "estimated", "planned"]
    assert true.get_linewidth() > 2.0 * estimated.get_linewidth()
    assert planned.is_dashed()
    assert planned.get_linewidth() < estimated.get_linewidth()


def test_arrivals_are_a_bar_for_each_run_of_used_values() -> None:
    """Ten due values a second, each used a tick later; the third and the last two are missing."""
    time = np.arange(30) / 30.0
    due = np.arange(30) % 3 == 0
    used = np.roll(due, 1)
    used[[7, 25, 28]] = False
    columns = {name: (("tick", "sensor"), values[:, np.newaxis]) for name, values in (("due", due), ("arrival", used))}
    flight = xr.Dataset(columns, coords={"time": ("tick", time), "sensor": ["camera"]})
    flight = xr.concat([flight, xr.zeros_like(flight).assign_coords(sensor=["uwb"])], "sensor")
    axes = Figure().add_subplot()
    draw_arrivals(axes, flight.astype(bool))
    drawn = [[path.get_extents().intervalx for path in bars.get_paths()] for bars in axes.collections]
    missing, there = (np.array(one) for one in drawn if one)
    np.testing.assert_allclose(missing, [(0.2, 0.3), (0.8, 1.0)], atol=1e-9)
    np.testing.assert_allclose(there, [(1 / 30, 0.2 + 1 / 30), (0.3 + 1 / 30, 0.8 + 1 / 30)], atol=1e-9)


def test_a_lost_flight_says_so_in_its_title() -> None:
    flight = fly(load_scenario("nominal_imu_uwb", "seconds=1"))
    assert draw_flight(flight).axes[0].get_title() == "nominal_imu_uwb, seed 0"
    flight.attrs["lost"] = '{"tick": 20, "time": 0.67, "cause": "tumbled"}'
    assert draw_flight(flight).axes[0].get_title() == "nominal_imu_uwb, seed 0: lost at 0.7 s: tumbled"
