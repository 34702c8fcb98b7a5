"""The ready-made flights stay what they were: bit for bit on a platform whose digests are kept, elsewhere to 1e-9 m."""

import json
from typing import Any

import numpy as np
import pytest
from flight_digests import FILE, PROJECTED, RENDERED, SEEDS, digest, fly_ready_made, this_platform, track

KEPT: dict[str, Any] = json.loads(FILE.read_text())


@pytest.mark.parametrize("seeds", [SEEDS[:1], pytest.param(SEEDS[1:], marks=pytest.mark.long)], ids=["one", "others"])
@pytest.mark.parametrize(("name", "camera"), PROJECTED)
def test_ready_made_flights_are_what_they_were(name: str, camera: str, seeds: range) -> None:
    digests = KEPT["digests"].get(this_platform(), {})
    for seed, flight in fly_ready_made(name, camera, seeds):
        key = f"{name} {camera} {seed}"
        if key in digests:
            assert digest(flight) == digests[key], key
        np.testing.assert_allclose(track(flight), KEPT["tracks"][key], rtol=0.0, atol=1e-9, err_msg=key)


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.parametrize(("name", "camera"), RENDERED)
def test_rendered_flights_are_what_they_were(name: str, camera: str) -> None:
    digests = {key: kept for key, kept in KEPT["digests"].get(this_platform(), {}).items() if " rendered " in key}
    if not digests:
        pytest.skip(f"no digests of rendered flights are kept for this platform: {this_platform()}")
    for seed, flight in fly_ready_made(name, camera):
        key = f"{name} {camera} {seed}"
        assert digest(flight) == digests[key], key
