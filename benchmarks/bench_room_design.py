"""What placed anchors, seen paths and surveys are worth: the tables of docs/how_to/room_design.md.

    python benchmarks/bench_room_design.py place     # a minute and a half
    python benchmarks/bench_room_design.py seen      # half a minute
    python benchmarks/bench_room_design.py landmarks # a minute
    python benchmarks/bench_room_design.py survey    # five minutes

All fly with walls that block and without the authors' imposed blackouts.
"""

import argparse
import tempfile
import time
from itertools import combinations
from pathlib import Path

import numpy as np
import xarray as xr
from example_rooms import example_room, two_ways

from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.onboard.planner.seen import FixSources, seen_at
from ortilo_drake.scenario import GcsPlanner, Scenario, load_scenario, with_seed
from ortilo_drake.studies.room_design.place import place_anchors, room_text
from ortilo_drake.studies.room_design.survey import survey
from ortilo_drake.studies.room_design.survey_data import flown_messages, ranges_of_flight
from ortilo_drake.world.drawn_truth import draw_truth

OPEN = ("uwb.walls.kind=block", "uwb.link.blackouts=[]")
ANCHORS = 8  # of a hall
KNOWN = (1, 8, 9)  # of the authors' room: far apart
ROUNDS = 100  # ranges between two anchors that see each other


def scenario_in(base: str, room: Room, folder: Path, *settings: str) -> Scenario:
    """Return a scenario in a room, which is written to the folder."""
    file = folder / f"{room.name}.yaml"
    file.write_text(room_text(room, room.name))
    return load_scenario(base, (*OPEN, f"room={file}", *settings))


def flown(scenario: Scenario, seeds: int) -> list[xr.Dataset]:
    """Return the flights of so many seeds."""
    simulator = FlightSimulator(scenario)
    return [simulator.fly(seed) for seed in range(seeds)]


def said_of(flights: list[xr.Dataset]) -> str:
    """Return the medians of RMS and largest error over the flights that were not lost, and how many were."""
    kept = [flight for flight in flights if flight.attrs["lost"] == "null"]
    e = [np.linalg.norm(f["estimate"].values[:, :3] - f["truth"].values[:, :3], axis=1) for f in kept]
    if not kept:
        return f"lost {len(flights)} of {len(flights)}"
    rms, largest = np.median([np.sqrt(np.mean(d**2)) for d in e]), np.median([d.max() for d in e])
    return f"RMS {rms:.4f} m, largest {largest:.3f} m, lost {len(flights) - len(kept)} of {len(flights)}"


def longest_gap(flight: xr.Dataset, scenario: Scenario) -> float:
    """Return the longest time of a flight between two uwb fixes that the filter took [s]."""
    fixes = np.flatnonzero(flight["arrival"].sel(sensor="uwb").values)
    return float(np.diff(np.concatenate([[0], fixes, [flight.sizes["tick"] - 1]])).max() * scenario.h)


def bench_place(base: str, seeds: int, folder: Path) -> None:
    """Print worst floors and flights before and after, in the authors' room and five halls."""
    rooms = [(load_room(), "planner.kind=gcs")]
    rooms += [(room, f"planner={{kind: gcs, start: [1, 0], goal: [{room.interior.max[0] - 1}, 0]}}")
              for room in (example_room(seed, ANCHORS) for seed in range(5))]  # fmt: skip
    for room, planner in rooms:
        scenario = scenario_in(base, room, folder, planner)
        started = time.perf_counter()
        found = place_anchors(scenario, len(room.anchors))
        took, gain = time.perf_counter() - started, 1.0 - found.after.floor / found.before.floor
        print(f"{room.name}: {found.before.floor:.4f} -> {found.after.floor:.4f} m, {gain:.0%} less, {took:.1f} s")
        print(f"    before: {said_of(flown(scenario, seeds))}")
        print(f"    after:  {said_of(flown(scenario_in(base, found.room, folder, planner), seeds))}", flush=True)


def bench_seen(base: str, seeds: int, folder: Path) -> None:
    """Print the longest time without a fix along the way through a hall with two ways."""
    for prefer in ("none", "seen"):
        ends = "start: [1.5, -2.2], goal: [18.5, -2.2], clearance: 0.8"
        scenario = scenario_in(base, two_ways(), folder, f"planner={{kind: gcs, {ends}, prefer: {prefer}}}")
        flights = flown(scenario, seeds)
        longest = np.median([longest_gap(flight, scenario) for flight in flights])
        end = float(flights[0]["time"][-1])
        print(f"{prefer}: longest without a fix {longest:.2f} s (median), flight {end:.0f} s, {said_of(flights)}")

    shares = []
    for room in (example_room(seed, 5) for seed in range(14)):
        ends = {"start": (1.0, 0.0), "goal": (room.interior.max[0] - 1.0, 0.0), "clearance": 0.6}
        found = []
        for prefer in ("none", "seen"):
            path = plan(GcsPlanner.model_validate({**ends, "prefer": prefer}), room, M100, FixSources(sensors=("uwb",)))
            at = path.vector_values(np.arange(0.0, path.end_time(), 0.1)).T
            seen = seen_at(at, room, FixSources(sensors=("uwb",)))
            gap = np.diff(np.flatnonzero(np.concatenate([[True], seen, [True]]))).max() * 0.1
            found.append((gap, path.end_time()))
        (before, short), (after, long) = found
        shares.append((after / before, long / short))
        print(f"{room.name}, planned: {before:.1f} -> {after:.1f} s without a fix, {short:.0f} -> {long:.0f} s")
    print(f"less than half in {sum(share < 0.5 for share, _ in shares)} of {len(shares)}", end=", ")
    print(f"duration {np.median([longer for _, longer in shares]):.3f} times")


def bench_landmarks(spacing: float = 1.5) -> None:
    """Print the worst floor of the authors' room with six placed anchors and other landmarks."""
    camera = ("camera.kind=projected", *OPEN)
    for count in (0, 4, 8, 16):
        found = place_anchors(load_scenario("nominal_imu_uwb_yolo", camera), 6, spacing, count)
        print(f"{count or 'the room'}: {found.after.floor:.4f} m", flush=True)
    found = place_anchors(load_scenario("nominal_imu_uwb_yolo", (*camera, "sensors=[uwb, imu]")), 6, spacing)
    print(f"without a camera: {found.after.floor:.4f} m")


def bench_survey(base: str, seeds: int) -> None:
    """Print how well anchors surveyed to 5 cm are found from a flight and ranges between anchors."""
    scenario = load_scenario(base, (*OPEN, "truth.survey.anchors_sd=0.05"))
    room, simulator = scenario.load_room(), FlightSimulator(scenario)
    free = [i for i in range(len(room.anchors)) if i not in KNOWN]
    errors, squares = [], []
    for seed in range(seeds):
        flight, its = simulator.fly(seed), with_seed(scenario, seed)
        drawn = draw_truth(its.truth, seed, room, {"uwb": 2 * len(room.anchors)})
        true = room.anchor_positions + drawn["survey.anchors"]
        ranges = ranges_of_flight(flight, its, flown_messages(its, flight["truth"].values), 5000)
        heard = [p for p in combinations(range(len(true)), 2) if not walls_crossed(*true[list(p)], room.wall_boxes)]
        pairs = np.repeat(heard, ROUNDS, axis=0)
        d = np.linalg.norm(true[pairs[:, 0]] - true[pairs[:, 1]], axis=1)
        noisy = d * (1.0 + 0.0075 * np.random.default_rng(seed).normal(size=d.size))
        believed = room.anchor_positions.copy()
        believed[list(KNOWN)] = true[list(KNOWN)]
        found = survey(ranges._replace(between=pairs, between_distance=noisy), believed, KNOWN, (0.0, 0.0075))
        e, where = (found.anchors - true)[free], (3 * np.array(free)[:, None] + np.arange(3)).ravel()
        errors.append(np.linalg.norm(e, axis=1))
        squares.append(float(e.ravel() @ np.linalg.solve(found.covariance[np.ix_(where, where)], e.ravel())))
        print(f"seed {seed}: {len(heard)} pairs, median {np.median(errors[-1]):.3f} m, {squares[-1]:.1f}", flush=True)
    far = np.array(errors)
    print(f"median {np.median(far):.3f} m, RMS {np.sqrt(np.mean(far**2)):.3f} m, 95 % {np.quantile(far, 0.95):.3f} m")
    print(f"normalised error squared {np.mean(squares):.1f}, {3 * len(free)} if honest")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("place", "seen", "landmarks", "survey"))
    parser.add_argument("--base", default=None, help="scenario; nominal_imu_uwb, for the survey imu_uwb")
    parser.add_argument("--seeds", type=int, default=20)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        if asked.what == "landmarks":
            bench_landmarks()
        elif asked.what == "survey":
            bench_survey(asked.base or "imu_uwb", asked.seeds)
        else:
            {"place": bench_place, "seen": bench_seen}[asked.what](
                asked.base or "nominal_imu_uwb", asked.seeds, Path(made)
            )
