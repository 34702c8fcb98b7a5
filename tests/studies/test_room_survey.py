"""The survey of anchors: against the truth over many draws, its own covariance, and what it reads."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import chi2

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.room_design.network import Network, Ranges, aligned, all_distances, mirror_images, scaled
from ortilo_drake.studies.room_design.survey import Survey, doubts, survey
from ortilo_drake.studies.room_design.survey_data import (
    flown_messages,
    logged_messages,
    ranges_of_flight,
    ranges_of_log,
    ranges_of_table,
    together,
)

ANCHORS = np.array(
    [[0.0, 0.0, 2.5], [6.0, 0.3, 0.6], [5.7, 5.0, 2.7], [0.2, 4.6, 0.4], [3.1, -0.2, 2.9], [2.8, 5.1, 1.2]]
)
KNOWN = (0, 1, 2)
NOISE = (0.03, 0.0)
PAIRS = np.array(list(combinations(range(len(ANCHORS)), 2)))


def length(v: np.ndarray) -> np.ndarray:
    return np.linalg.norm(v, axis=1)


def draw(rng: np.random.Generator, places: int, rounds: int, sd: float = NOISE[0], p_sd: float = np.inf) -> Ranges:
    """Return ranges from random places, and of so many rounds between all anchors."""
    p = rng.uniform([0.5, 0.5, 0.5], [5.5, 4.5, 2.0], (places, 3))
    place, anchor = (part.ravel() for part in np.meshgrid(range(places), range(len(ANCHORS)), indexing="ij"))
    pairs = np.tile(PAIRS, (rounds, 1))
    d, between = length(p[place] - ANCHORS[anchor]), length(ANCHORS[pairs[:, 0]] - ANCHORS[pairs[:, 1]])
    noisy = d + sd * rng.normal(size=d.size), between + sd * rng.normal(size=between.size)
    known = p + p_sd * rng.normal(size=p.shape) if np.isfinite(p_sd) else np.full((places, 3), np.nan)
    return Ranges(place, anchor, noisy[0], pairs, noisy[1], known, np.full(places, p_sd))


def believed(rng: np.random.Generator, sd: float = 0.3) -> np.ndarray:
    found = ANCHORS + sd * rng.normal(size=ANCHORS.shape)
    found[list(KNOWN)] = ANCHORS[list(KNOWN)]
    return found


def nees(found: Survey) -> float:
    e = (found.anchors - ANCHORS)[3:].ravel()
    return float(e @ np.linalg.solve(found.covariance[9:, 9:], e))


def test_scaling_gives_back_the_distances_and_one_image_the_points() -> None:
    D = np.linalg.norm(ANCHORS[:, None] - ANCHORS[None], axis=2)
    pairs = PAIRS[:, ::-1]
    np.testing.assert_allclose(all_distances(pairs, length(ANCHORS[pairs[:, 0]] - ANCHORS[pairs[:, 1]]), 6), D)
    found = scaled(D)
    np.testing.assert_allclose(np.linalg.norm(found[:, None] - found[None], axis=2), D, atol=1e-9)
    images = [aligned(found, ANCHORS[:3], sign) for sign in (1.0, -1.0)]
    assert min(np.abs(image - ANCHORS).max() for image in images) < 1e-9
    normal = np.cross(ANCHORS[1] - ANCHORS[0], ANCHORS[2] - ANCHORS[0])
    mirrored = ANCHORS - 2.0 * np.outer((ANCHORS - ANCHORS[0]) @ normal, normal) / (normal @ normal)
    assert min(np.abs(image - mirrored).max() for image in images) < 1e-9


def test_ranges_that_do_not_connect_give_no_image() -> None:
    assert mirror_images(PAIRS[:3], np.ones(3), ANCHORS, KNOWN) == []
    assert mirror_images(np.empty((0, 2), int), np.empty(0), ANCHORS, KNOWN) == []


def test_the_jacobian_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    network = Network(draw(rng, 3, 1, p_sd=0.5), ANCHORS, [3, 4, 5])
    x, sd = rng.uniform(0.0, 3.0, 18), rng.uniform(0.1, 1.0, 18 + 15)
    found = network.jacobian(x, sd).toarray()
    np.testing.assert_allclose(found, approx_fprime(x, lambda x: network.residuals(x, sd), 1e-7), atol=1e-5)


def test_the_covariance_is_that_block_of_the_whole_inverse() -> None:
    rng = np.random.default_rng(2)
    network = Network(draw(rng, 8, 1), ANCHORS, [3, 4, 5])
    x = np.concatenate([ANCHORS[3:].ravel(), rng.uniform(1.0, 3.0, 24)])
    sd = np.full(48 + 15, 0.1)
    J = network.jacobian(x, sd).toarray()
    np.testing.assert_allclose(network.covariance(x, sd), np.linalg.inv(J.T @ J)[:9, :9], rtol=1e-4, atol=1e-9)


def test_ranges_without_noise_give_the_anchors_whatever_was_believed() -> None:
    rng = np.random.default_rng(3)
    found = survey(draw(rng, 12, 1, sd=0.0), believed(rng, 0.5), KNOWN, NOISE)
    np.testing.assert_allclose(found.anchors, ANCHORS, atol=1e-6)
    assert (found.sd[:3] == 0.0).all()
    assert (found.sd[3:] > 0.0).all()


@pytest.mark.long
def test_over_200_draws_95_in_100_anchors_are_within_5_cm_and_the_uncertainty_is_honest() -> None:
    rng = np.random.default_rng(4)
    squares, errors, costs, freedom = [], [], [], 0
    for _ in range(200):
        found = survey(draw(rng, 10, 8), believed(rng), KNOWN, NOISE)
        squares.append(nees(found))
        errors.append(found.anchors - ANCHORS)
        costs.append(found.chi2)
        freedom = found.freedom
    distance = np.linalg.norm(np.array(errors)[:, 3:], axis=2)
    assert np.quantile(distance, 0.95) < 0.05
    # Sums of 200 chi-squares of 9 degrees, and of as many as the fit leaves, within their 99.9 % bands.
    low, high = chi2.ppf([0.0005, 0.9995], 200 * 9)
    assert low < sum(squares) < high
    low, high = chi2.ppf([0.0005, 0.9995], 200 * freedom)
    assert low < sum(costs) < high
    assert freedom == 10 * 6 + 8 * 15 - 9 - 30


@pytest.mark.long
def test_known_places_and_no_ranges_between_anchors_are_honest_too() -> None:
    rng = np.random.default_rng(5)
    squares = [nees(survey(draw(rng, 15, 0, p_sd=0.02), believed(rng), KNOWN, NOISE)) for _ in range(60)]
    low, high = chi2.ppf([0.0005, 0.9995], 60 * 9)
    assert low < sum(squares) < high


@pytest.mark.long
def test_a_robust_loss_bears_outliers() -> None:
    rng = np.random.default_rng(6)
    ranges = draw(rng, 30, 3)
    ranges.distance[::12] += 1.5
    start = believed(rng)
    plain, robust = (survey(ranges, start, KNOWN, NOISE, loss) for loss in ("linear", "cauchy"))
    assert np.abs(robust.anchors - ANCHORS).max() < 0.06
    assert np.abs(plain.anchors - ANCHORS).max() > 2.0 * np.abs(robust.anchors - ANCHORS).max()
    assert plain.chi2 > 5.0 * plain.freedom


@pytest.mark.parametrize(
    ("known", "named"),
    [((0, 1), "three different"), ((0, 1, 1), "three different"), ((0, 1, 9), "0 to 5"), ((0, 1, 6), "0 to 5")],
)
def test_wrong_known_anchors_are_refused(known: tuple[int, ...], named: str) -> None:
    with pytest.raises(InputError, match=named):
        survey(draw(np.random.default_rng(0), 5, 1), ANCHORS, known, NOISE)


def test_anchors_that_cannot_be_found_are_refused() -> None:
    rng = np.random.default_rng(7)
    ranges = draw(rng, 10, 0)
    few = ranges.anchor != 5
    ranges = ranges._replace(place=ranges.place[few], anchor=ranges.anchor[few], distance=ranges.distance[few])
    with pytest.raises(InputError, match="anchor 5: 0 usable ranges"):
        survey(ranges, ANCHORS, KNOWN, NOISE)
    line = ANCHORS.copy()
    line[:3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [2.0, 0.0, 1.0]]
    with pytest.raises(InputError, match="on one line"):
        survey(draw(rng, 5, 1), line, KNOWN, NOISE)
    one_place = draw(rng, 3, 0, p_sd=0.01)
    same = one_place._replace(p=np.tile(one_place.p[0], (3, 1)))
    with pytest.raises(InputError, match="leave its place open"):
        survey(same, believed(rng), KNOWN, NOISE)


def test_a_table_is_read(tmp_path: Path) -> None:
    file = tmp_path / "ranges.csv"
    file.write_text(
        "from, to, range, x, y, z, sd\na0,a1,6.5,,,,\n0.1,a0,2.0,1,2,3,0.1\n0.1,a3,2.5,1,2,3,0.1\nhall,a3,3,4,5,6,\n"
        "b,a2,1e0,,,,\n"
    )
    found = ranges_of_table(file, 4)
    assert found.place.tolist() == [0, 0, 1, 2]
    assert found.anchor.tolist() == [0, 3, 3, 2]
    assert found.distance.tolist() == [2.0, 2.5, 3.0, 1.0]
    assert found.between.tolist() == [[0, 1]]
    assert found.between_distance.tolist() == [6.5]
    np.testing.assert_array_equal(found.p, [[1, 2, 3], [4, 5, 6], [np.nan] * 3])
    assert found.p_sd.tolist() == [0.1, np.inf, np.inf]
    twice = together([found, found])
    assert twice.place.tolist() == [0, 0, 1, 2, 3, 3, 4, 5]
    assert len(twice.p) == 6


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "column from: is missing"),
        ("from,to\n", "column range: is missing"),
        ("from,to,range,w\n", "column 'w'"),
        ("from,to,range\na0,a1\n", "line 2: must have 3 values"),
        ("from,to,range\na0,a1,-1\n", "line 2: range: '-1'"),
        ("from,to,range\na0,a1,nan\n", "line 2: range: 'nan'"),
        ("from,to,range\na0,b,1\n", "line 2: to: 'b': must be an anchor, a0 to a3"),
        ("from,to,range\na0,a9,1\n", "line 2: to: 'a9'"),
        ("from,to,range\na1,a1,1\n", "must not be the anchor in to"),
        ("from,to,range,x,y,z\nq,a1,1,1,,2\n", "x, y, z: must be three numbers"),
        ("from,to,range,x,y,z,sd\nq,a1,1,1,1,2,0\n", "line 2: sd: '0'"),
        ("from,to,range,x,y,z,sd\nq,a1,1,,,,1\n", "must be empty where x, y, z are"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path: Path, text: str, named: str) -> None:
    file = tmp_path / "ranges.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=r"ranges\.csv: ") as error:
        ranges_of_table(file, 4)
    assert named in str(error.value)


def test_ranges_of_a_flight_are_those_of_its_log(tmp_path: Path) -> None:
    walls = ("uwb.walls.kind=bias", "uwb.behind_walls=used")
    loss, moved = "uwb.link.loss=0.3", "truth.survey.anchors_sd=0.1"
    path = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.7]]}"
    flight = fly_logged(load_scenario("nominal_imu_uwb", (*walls, loss, moved, path), 5), tmp_path / "log")
    scenario = scenario_of(flight)
    messages = flown_messages(scenario, flight["truth"].values)
    logged = logged_messages(tmp_path / "log")
    assert 10 < len(logged) < 30
    np.testing.assert_array_equal(messages[: len(logged)], logged)
    assert len(messages) - len(logged) <= 1  # the flight's last tick
    here, there = ranges_of_flight(flight, scenario, logged, 8), ranges_of_log(tmp_path / "log", 8)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(here.p) == 8
    assert len(here.distance) == 8 * 12
    believed_ranges = length(here.p[here.place] - scenario.load_room().anchor_positions[here.anchor])
    assert 0.05 < np.std(here.distance - believed_ranges) < 0.5


def test_doubts_are_told() -> None:
    rng = np.random.default_rng(8)
    ranges, start = draw(rng, 12, 3), believed(rng)
    assert doubts(survey(ranges, start, KNOWN, NOISE), ranges) == []
    for wrong, named in (((0.01, 0.0), "disagree by more than their noise"), ((0.2, 0.0), "set too high")):
        (said,) = doubts(survey(ranges, start, KNOWN, wrong), ranges)
        assert named in said
    flat = draw(rng, 12, 0, p_sd=0.02)
    p = flat.p.copy()
    p[:, 2] = 1.5
    distance = length(p[flat.place] - ANCHORS[flat.anchor])
    ranges = flat._replace(p=p, distance=distance + 0.03 * rng.normal(size=distance.size))
    (said,) = doubts(survey(ranges, ANCHORS, KNOWN, NOISE), ranges)
    assert "of a plane: on which side" in said


def test_an_anchor_believed_on_the_wrong_side_of_a_flight_at_one_height_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(9)
    flown = draw(rng, 40, 0, p_sd=0.01)
    p = flown.p.copy()
    p[:, 2] = 1.5 + 0.03 * rng.normal(size=40)
    distance = length(p[flown.place] - ANCHORS[flown.anchor])
    pairs = np.array([[3, 0], [3, 1], [3, 2]])  # these alone do not connect the anchors
    between = length(ANCHORS[pairs[:, 0]] - ANCHORS[pairs[:, 1]])
    flown = flown._replace(
        p=p + 0.01 * rng.normal(size=p.shape),
        distance=distance + 0.03 * rng.normal(size=distance.size),
        between=pairs,
        between_distance=between + 0.03 * rng.normal(size=3),
    )
    start = ANCHORS.copy()
    start[3, 2] = 3.0 - start[3, 2]
    found = survey(flown, start, KNOWN, NOISE)
    assert np.abs(found.anchors - ANCHORS)[3].max() < 0.1
    monkeypatch.setattr("ortilo_drake.studies.room_design.survey.MOST_FITS", 0)  # the last better side counts, too
    assert np.abs(survey(flown, start, KNOWN, NOISE).anchors - ANCHORS)[3].max() < 0.1
    monkeypatch.setattr("ortilo_drake.studies.room_design.survey.better_sides", lambda network, x, sd, loss: (x, False))
    assert survey(flown, start, KNOWN, NOISE).anchors[3, 2] > 2.0
