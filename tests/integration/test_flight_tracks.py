"""The ready-made flights stay what they were: to 1e-9 m on any processor, rendered ones as far as rounding lets."""

import json

import numpy as np
import pytest
from flight_tracks import FILE, PROJECTED, RENDERED, SEEDS, fly_ready_made, track

KEPT: dict[str, list[list[float]]] = json.loads(FILE.read_text())
ONE, OTHERS = SEEDS["projected"][:1], SEEDS["projected"][1:]


def check(name: str, camera: str, seeds: range, tolerance: float, player: str = "drake") -> None:
    for seed, flight in fly_ready_made(name, camera, seeds, player):
        key = f"{name} {camera} {seed}"
        np.testing.assert_allclose(track(flight), KEPT[key], rtol=0.0, atol=tolerance, err_msg=key)


@pytest.mark.family("nominal_imu_uwb_yolo-projected-one-engine")
@pytest.mark.parametrize("player", ["engine", "drake"])
@pytest.mark.parametrize("seeds", [ONE, OTHERS], ids=["one", "others"])
@pytest.mark.parametrize(("name", "camera"), PROJECTED)
def test_ready_made_flights_are_what_they_were(name: str, camera: str, seeds: range, player: str) -> None:
    check(name, camera, seeds, 1e-9, player)


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.parametrize(("name", "camera"), RENDERED)
def test_rendered_flights_are_what_they_were(name: str, camera: str) -> None:
    """The detector computes in single precision, whose sums differ between processors: the same code is 0.9 mm apart.

    The paper's own filter magnifies that: on one processor its flights by the detector's three backends, which add in
    other orders, are up to 1.6 cm apart.
    """
    check(name, camera, SEEDS[camera], 5e-2 if name.startswith("paper") else 2e-3)
