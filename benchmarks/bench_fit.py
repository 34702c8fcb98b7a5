"""How often the intervals of `ortilo fit` hold what made the errors: the table of docs/how_to/real_flights.md.

    python benchmarks/bench_fit.py --workers 6 --json out/fit.json
    python benchmarks/bench_fit.py --kinds ranges --recordings 10

A simulated recording has 3 s of rest and 40 s of flight: 320 ranges a second to eight anchors, or differences of
neighbours, an IMU at 250 Hz, and a truth at 100 Hz that is rounded to 1 mm and 0.001, in tables.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.interop.recorded.recording import GRAVITY, read_recording
from ortilo_drake.model.typed_yaml import parse_yaml, validate
from ortilo_drake.scenario.noise_file import FieldNoise, LastingNoise, Outliers, UwbNoise
from ortilo_drake.studies.fit.fit import fit_recordings
from ortilo_drake.studies.predict.predicted import draw_errors, numbers_of
from ortilo_drake.world.sensors.fitted_uwb import draw_day

ANCHORS = np.array([(x, y, z) for z in (0.2, 2.8) for x, y in ((-3, -4), (3, -4), (3, 4), (-3, 4))], dtype=float)
REST, FLIGHT, RATE, IMU_RATE, TRUTH_RATE = 3.0, 40.0, 320, 250, 100
ROTATION, FORCE = np.array([0.004, 0.005, 0.006]), np.array([0.05, 0.06, 0.07])  # densities of the IMU
LIKE_RANGES = UwbNoise(
    white=0.03,
    freedom=4.0,
    lasting=LastingNoise(time=0.55, sd=0.045),
    outliers=Outliers(share=0.01, sd=0.5, burst=1.5),
    constants_sd=0.07,
)
LIKE_DIFFERENCES = UwbNoise(
    white=0.035,
    freedom=1.4,
    lasting=LastingNoise(time=0.6, sd=0.17),
    outliers=Outliers(share=0.03, sd=1.0, burst=1.5),
    constants_sd=0.08,
    differences=True,
)
KINDS = {
    "ranges": LIKE_RANGES,
    "differences": LIKE_DIFFERENCES,
    "places": LIKE_DIFFERENCES.model_copy(
        update={"white": 0.06, "freedom": None, "field": FieldNoise(length=0.8, sd=0.2)}
    ),
}
NAMES = list(map(str, range(len(ANCHORS))))
MAP = f"""
KIND
anchors: {ANCHORS.tolist()}
imu: {{file: imu.csv, time: t, rates: [wx, wy, wz], force: [fx, fy, fz]}}
truth: {{file: truth.csv, time: t, position: [x, y, z], rotation: {{columns: [qx, qy, qz, qw]}}}}
calibration: {{share: 0, clock: 0, frame: same, biases: online, lever: [0, 0, 0]}}
airborne: 0.3
"""
ROWS = {
    False: f"ranges: {{file: uwb.csv, time: t, anchor: b, values: [r], names: {NAMES}}}",
    True: f"differences: {{file: uwb.csv, time: t, value: r, a: a, b: b, names: {NAMES}}}",
}


def place(t: np.ndarray) -> np.ndarray:
    """Return the positions (m, 3): up within 2 s after the rest, then two loops that are never quite the same."""
    s, rises = np.maximum(t - REST, 0.0), np.clip((t - REST) / 2.0, 0.0, 1.0)
    up = rises**3 * (10.0 - 15.0 * rises + 6.0 * rises**2)
    return np.column_stack(
        [1.8 * np.sin(0.8 * s) * up, 2.5 * np.sin(0.59 * s) * up, (1.3 + 0.5 * np.sin(0.97 * s)) * up]
    )


def attitude(t: np.ndarray) -> Rotation:
    """Return R_WB: level while at rest."""
    s = np.maximum(t - REST, 0.0)
    angles = np.column_stack([0.5 * np.sin(0.45 * s), 0.10 * np.sin(0.9 * s) ** 2, 0.08 * np.sin(0.7 * s) ** 2])
    return Rotation.from_euler("ZYX", angles)


def write_recording(folder: Path, noise: UwbNoise, rng: np.random.Generator) -> np.ndarray:
    """Write the tables of a recording, and return the anchors' constants (n)."""
    day, n = draw_day(noise, len(ANCHORS), numbers_of(rng)), len(ANCHORS)
    t = np.arange(0.0, REST + FLIGHT, 1.0 / RATE)
    b = np.arange(len(t)) % n
    a = (b + 1) % n if noise.differences else np.full(len(t), -1)
    p = place(t)
    r = np.linalg.norm(p - ANCHORS[b], axis=1)
    if noise.differences:
        r -= np.linalg.norm(p - ANCHORS[a], axis=1)
    r += draw_errors(Ranges(t, b, r, a, 0 * b), p, 0.0, noise, day, rng)
    _write(folder / "uwb.csv", "t,a,b,r", t, a, b, r)

    t, h = np.arange(0.0, REST + FLIGHT, 1.0 / IMU_RATE), 1e-3
    a_W = (place(t + h) - 2.0 * place(t) + place(t - h)) / h**2
    rates = (attitude(t - h).inv() * attitude(t + h)).as_rotvec() / (2.0 * h)
    force = attitude(t).inv().apply(a_W + [0.0, 0.0, GRAVITY])
    white = np.sqrt(IMU_RATE) * rng.standard_normal((2, len(t), 3))
    _write(folder / "imu.csv", "t,wx,wy,wz,fx,fy,fz", t, rates + ROTATION * white[0], force + FORCE * white[1])

    t = np.arange(0.0, REST + FLIGHT, 1.0 / TRUTH_RATE)
    _write(folder / "truth.csv", "t,x,y,z,qx,qy,qz,qw", t, place(t).round(3), attitude(t).as_quat().round(3))
    return day.constants - (day.constants.mean() if noise.differences else 0.0)


def _write(file: Path, head: str, *columns: np.ndarray) -> None:
    np.savetxt(file, np.column_stack(columns), "%.9g", ",", header=head, comments="")


def true_numbers(noise: UwbNoise, constants: np.ndarray) -> dict[str, float]:
    """Return what made the errors, by the names of NOISE.yaml."""
    assert noise.lasting is not None
    found = {
        "uwb.white": noise.white,
        "uwb.lasting.time": noise.lasting.time,
        "uwb.lasting.sd": noise.lasting.sd,
        "uwb.outliers.share": noise.outliers.share,
        "uwb.outliers.sd": noise.outliers.sd,
    }
    if noise.freedom is not None:
        found["uwb.freedom"] = noise.freedom
    if noise.field is not None:
        found |= {"uwb.field.length": noise.field.length, "uwb.field.sd": noise.field.sd}
    found |= {f"uwb.constants.{i}": float(c) for i, c in enumerate(constants)}
    for part, densities in (("rotation", ROTATION), ("force", FORCE)):
        for end in ("", "_rest"):
            found |= {f"imu.{part}{end}.{axis}": float(d) for axis, d in zip("xyz", densities, strict=True)}
    return found


def fit_one(job: tuple[str, int]) -> tuple[str, int, dict[str, tuple[float, float, float]]]:
    """Return the kind, the seed, and by name what made the errors and the fitted interval."""
    kind, seed = job
    noise = KINDS[kind]
    map_ = validate(Map, parse_yaml(MAP.replace("KIND", ROWS[noise.differences]), "MAP.yaml"), "MAP.yaml")
    with tempfile.TemporaryDirectory() as folder:
        constants = write_recording(Path(folder), noise, np.random.default_rng((list(KINDS).index(kind), seed)))
        found = fit_recordings([read_recording(Path(folder), map_)], map_, noise.field is not None)
    true = true_numbers(noise, constants)
    return kind, seed, {name: (true[name], *ends) for name, ends in found.intervals.items()}


def group(name: str) -> str:
    """Return the name of the numbers that are counted together: axes and anchors of one kind."""
    first, last = name.rsplit(".", 1)
    return first if last.isdigit() or last in "xyz" else name


def coverage(fits: dict[str, dict[str, tuple[float, float, float]]]) -> dict[str, list[float]]:
    """Return by group how many intervals hold their number, of how many, and the share's interval of 95 % (exact)."""
    held: dict[str, list[bool]] = {}
    for found in fits.values():
        for name, (true, low, high) in found.items():
            held.setdefault(group(name), []).append(low <= true <= high)
            held.setdefault("all", []).append(low <= true <= high)
    return {name: [sum(its), len(its), *binomtest(sum(its), len(its)).proportion_ci()] for name, its in held.items()}


def jobs(kinds: list[str], recordings: int, kept: dict) -> Iterator[tuple[str, int]]:
    """Return what is still to be fitted, all kinds in turn."""
    return ((kind, seed) for seed in range(recordings) for kind in kinds if str(seed) not in kept[kind])


def main() -> None:
    """Fit, keep and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--recordings", type=int, default=100)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, default=Path("out/fit.json"), help="kept as they come, and continued")
    given = parser.parse_args()
    fits: dict = json.loads(given.json.read_text())["fits"] if given.json.exists() else {}
    fits = {kind: {} for kind in given.kinds} | fits
    given.json.parent.mkdir(parents=True, exist_ok=True)
    with get_context("spawn").Pool(given.workers) as pool:
        for kind, seed, found in pool.imap_unordered(fit_one, jobs(given.kinds, given.recordings, fits)):
            fits[kind][str(seed)] = found
            partial = given.json.with_suffix(".part")
            partial.write_text(json.dumps({"coverage": {its: coverage(fits[its]) for its in fits}, "fits": fits}))
            partial.replace(given.json)
    for kind in fits:
        print(f"{kind}: {len(fits[kind])} recordings")
        for name, (held, of, low, high) in coverage(fits[kind]).items():
            print(f"  {name:22} {held} of {of}: {held / of:.3f} [{low:.2f}, {high:.2f}]")


if __name__ == "__main__":
    main()
