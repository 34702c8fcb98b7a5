"""The estimators against closed forms and SciPy, and together: a known camera's own detections give it back."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy import stats

from ortilo_drake.diagrams.wiring.world import sensor_system
from ortilo_drake.flight.flight import fly
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import DETECTION_SIZE, PAYLOAD
from ortilo_drake.model.typed_yaml import InputError, load_yaml, validate
from ortilo_drake.scenario import Camera as Settings
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.camera import MeasuredErrors
from ortilo_drake.training.calibration import calibrate as calibration_of
from ortilo_drake.training.calibration.measured_errors import (
    both_below,
    fit_slow,
    fit_table,
    knot_shares,
    latent_correlation,
    slow_correlation,
)
from ortilo_drake.training.calibration.sightings import LEAST_OVERLAP, is_whole, match_landmarks, sightings
from ortilo_drake.world.sensors.camera_calibration import CameraCalibration, load_calibration
from ortilo_drake.world.sensors.landmark_view import DISTANCE, VISIBLE

pytestmark = pytest.mark.training

ROOM = load_room()
SIZE = 320, 240
KNOTS = np.array([0.0, 1.0, 3.0, 7.0])


@given(st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4), st.floats(0.5, 2.0))
def test_a_table_is_fitted_exactly_where_the_data_are_exact(values, gain):
    at = np.linspace(-1.0, 8.0, 50)
    y = gain * np.interp(at, KNOTS, values)
    fitted = fit_table(KNOTS, at, y, np.zeros(4), 1e-9, np.full(50, gain))
    np.testing.assert_allclose(fitted, values, atol=1e-6)


def test_knots_without_data_keep_the_prior_and_few_data_move_it_little():
    prior = np.array([0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(fit_table(KNOTS, np.array([]), np.array([]), prior, 10.0), prior)
    # One observation of 1 at a knot against ten of 0.2.
    fitted = fit_table(KNOTS, np.array([1.0]), np.array([1.0]), prior, 10.0)
    np.testing.assert_allclose(fitted, [0.1, 3.0 / 11.0, 0.3, 0.4])


@hypothesis_settings(max_examples=25)
@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95), st.floats(0.0, 0.95))
def test_the_chance_that_both_are_below_agrees_with_scipy(p, q, rho):
    expected = stats.multivariate_normal.cdf(stats.norm.ppf([p, q]), cov=[[1.0, rho], [rho, 1.0]])
    assert both_below(np.array([p]), np.array([q]), rho)[0] == pytest.approx(expected, abs=1e-5)


def test_latent_correlation_is_found_again():
    rng = np.random.default_rng(1)
    z = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.6], [0.6, 1.0]], size=40000)
    p, q = rng.uniform(0.3, 0.95, (2, 40000))
    both = np.sum((stats.norm.cdf(z[:, 0]) < p) & (stats.norm.cdf(z[:, 1]) < q))
    assert latent_correlation(p, q, int(both)) == pytest.approx(0.6, abs=0.03)


@pytest.mark.parametrize("lag", [0.0, 0.3, 1.0, 1.7, 2.5])
def test_slow_correlation_agrees_with_a_simulation(lag):
    rng = np.random.default_rng(2)
    nodes, t = rng.standard_normal((40000, 4)), rng.uniform(0.0, 1.0, 40000)

    def value(at):
        k = np.floor(at).astype(int)
        a, rows = at - k, np.arange(len(at))
        return ((1 - a) * nodes[rows, k] + a * nodes[rows, np.minimum(k + 1, 3)]) / np.hypot(1 - a, a)

    assert slow_correlation(np.array(lag)) == pytest.approx(np.mean(value(t) * value(t + lag)), abs=0.02)


@pytest.mark.parametrize(("share", "spacing"), [(0.3, 4.0), (0.8, 15.0)])
def test_the_slow_part_is_found_again(share, spacing):
    lags = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0])
    found = fit_slow(lags, share * slow_correlation(lags / spacing), np.ones(8))
    assert found == pytest.approx((share, spacing), rel=0.1)


boxes = st.lists(st.tuples(*[st.floats(0.0, 40.0)] * 2, *[st.floats(5.0, 40.0)] * 2), min_size=1, max_size=3).map(
    lambda rows: np.array([[u, v, u + w, v + h] for u, v, w, h in rows])
)


def gain(seen, truth) -> float:
    (u_0, v_0, u_1, v_1), (p_0, q_0, p_1, q_1) = seen, truth
    both = max(min(u_1, p_1) - max(u_0, p_0), 0.0) * max(min(v_1, q_1) - max(v_0, q_0), 0.0)
    iou = both / ((u_1 - u_0) * (v_1 - v_0) + (p_1 - p_0) * (q_1 - q_0) - both)
    return iou + 0.2 if iou > LEAST_OVERLAP else 0.0


@hypothesis_settings(deadline=None, max_examples=50)  # the first call compiles
@given(boxes, boxes, st.integers(0, 2))
def test_matching_is_the_best_of_all_pairings(seen, truth, odd):
    labels, truth_labels = np.zeros(len(seen)), np.zeros(len(truth))
    labels[odd % len(seen)] = 1.0  # of another class: matches nothing
    of = match_landmarks(labels, seen, truth_labels, truth, np.ones(len(truth)))
    table = np.array(
        [[(1.0 - label) * gain(box, other) for other in truth] for label, box in zip(labels, seen, strict=True)]
    )
    assert all(table[k, i] > 0.0 for k, i in enumerate(of) if i >= 0)
    places = [*range(len(truth)), *[-1] * len(seen)]
    best = max(
        sum(table[k, i] for k, i in enumerate(chosen) if i >= 0) for chosen in set(permutations(places, len(seen)))
    )
    assert sum(table[k, i] for k, i in enumerate(of) if i >= 0) == pytest.approx(best, abs=1e-9)


def known_calibration() -> CameraCalibration:
    """A camera unlike the shipped one, simple to say."""
    data = load_calibration(MeasuredErrors()).model_dump(mode="json")
    distance, shares = [1.0, 6.0, 17.0], [0.0, 0.5, 1.0]
    rates = {name: [0.98, 0.9, 0.0] for name in ("other", *ROOM.classes)} | {"person": [0.9, 0.6, 0.1]}
    data["found"] = {
        "distance": distance,
        "rate": rates,
        "inside": shares,
        "inside_factor": [0.2, 0.8, 1.0],
        "visible": shares,
        "visible_factor": [0.0, 0.6, 1.0],
    }
    skewed = [-3.0, -1.3, 0.1, 1.2, 4.0]
    data["errors"] |= {
        "size": [5.0, 50.0, 100.0],
        "center": [0.5, 1.0, 1.5],
        "extent": [0.8, 2.0, 4.0],
        "visible_growth": [1.0] * len(shares),
        "inside_growth": [3.0, 2.0, 1.0],
        "border_factor": [0.0, 0.0, 0.0],
        "normal": [-3.0, -1.0, 0.0, 1.0, 3.0],
        "quantiles": dict.fromkeys(data["errors"]["quantiles"], skewed),
    }
    data["slow_errors"], data["slow_misses"] = {"share": 0.6, "period": 1.0}, {"share": 0.5, "period": 0.4}
    data["false_boxes"] |= {"mean": 0.3}
    return validate(CameraCalibration, data, "known")


@pytest.fixture(scope="module")
def recovered(tmp_path_factory):
    """A known camera, and what is estimated of it on flights past the room's landmarks."""
    known, file = known_calibration(), tmp_path_factory.mktemp("known") / "known.yaml"
    calibration_of.write_calibration(known, file)
    errors = MeasuredErrors(file=str(file))
    assert load_calibration(errors) == known
    flights = []
    for seed in range(6):
        scenario = load_scenario(calibration_of.SCENARIO, calibration_of.GIVEN_ERRORS, seed)
        states, found = fly(scenario)["truth"].values[::3], []
        seeing = scenario.model_copy(update={"camera": Settings(errors=errors)})
        camera = sensor_system(seeing, ROOM, "camera")
        context, port = camera.CreateDefaultContext(), camera.GetInputPort("state")
        camera.set_seed_in(context, seed)
        for k, x in enumerate(states):
            context.SetTime(3 * k * scenario.h)
            port.FixValue(context, x)
            rows = camera.get_output_port().Eval(context)[PAYLOAD:].reshape(-1, DETECTION_SIZE)
            rows = rows[rows[:, 0] >= 0.0]
            found.append((rows[:, 0].astype(int), rows[:, 1], rows[:, 2:]))
        flights.append((states, found))
    seen = sightings(ROOM, 320, flights)
    estimated = calibration_of.estimate(seen, ROOM.classes, SIZE, 0.1, known.source.model_dump(mode="json"))
    return known, estimated, seen


def test_detection_rates_are_recovered(recovered):
    known, estimated, seen = recovered
    clear = is_whole(seen.view) & (seen.view[:, VISIBLE] >= 0.95) & (seen.view[:, DISTANCE] < 12.0)
    for c, name in enumerate(ROOM.classes):
        distance = seen.view[clear & (seen.label == c), DISTANCE]
        rates = [np.interp(distance, x.found.distance, x.found.rate[name]) for x in (known, estimated)]
        assert np.sqrt(np.mean((rates[0] - rates[1]) ** 2)) < 0.05, name  # slow misses leave few independent sightings
    person = estimated.found.rate["person"]
    assert np.interp(5.0, estimated.found.distance, person) == pytest.approx(0.66, abs=0.08)
    for at, factor, true in ((0.5, estimated.found.inside_factor, 0.8), (0.85, estimated.found.inside_factor, 0.94)):
        assert np.interp(at, estimated.found.inside, factor) == pytest.approx(true, abs=0.08)
    assert np.interp(0.5, estimated.found.visible, estimated.found.visible_factor) == pytest.approx(0.6, abs=0.15)


def test_errors_of_boxes_are_recovered(recovered):
    known, estimated, _ = recovered
    # A table's size and its quantiles' can be traded: only their product, the error itself, is measured.
    for size in (20.0, 40.0, 70.0):
        for part, quantities in (("center", ("center_u", "center_v")), ("extent", ("width", "height"))):
            for quantity in quantities:
                quantiles = []
                for calibration in (known, estimated):
                    errors = calibration.errors
                    mean = np.interp(size, errors.size, getattr(errors, part))
                    z = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
                    quantiles.append(mean * np.interp(z, errors.normal, errors.quantiles[quantity]))
                spread = quantiles[0][3] - quantiles[0][1]
                assert np.abs(quantiles[1] - quantiles[0]).max() < 0.15 * spread, (size, quantity)


def test_growth_on_cut_landmarks_and_at_the_border_is_recovered(recovered):
    _, estimated, _ = recovered
    inside = estimated.found.inside
    for at, true in ((0.5, 2.0), (0.8, 1.4)):
        assert np.interp(at, inside, estimated.errors.inside_growth) == pytest.approx(true, rel=0.2)
    assert np.interp(0.7, inside, estimated.errors.border_factor) < 0.5  # edges that never leave the border


def test_persistence_is_recovered(recovered):
    known, estimated, _ = recovered
    for slow, true in ((estimated.slow_errors, known.slow_errors), (estimated.slow_misses, known.slow_misses)):
        assert slow.share == pytest.approx(true.share, abs=0.12)
        assert slow.period == pytest.approx(true.period, rel=0.5)


def test_false_boxes_are_recovered(recovered):
    known, estimated, seen = recovered
    # Those that happen to lie on a landmark of their class count as found: a few in a hundred.
    assert estimated.false_boxes.mean == pytest.approx(known.false_boxes.mean, rel=0.12)
    for name, share in known.false_boxes.classes.items():
        assert estimated.false_boxes.classes[name] == pytest.approx(share, abs=0.05)
    assert seen.pictures == 6 * 743


def test_a_calibration_is_written_and_read_back(tmp_path, recovered):
    _, estimated, _ = recovered
    file = tmp_path / "new" / "calibration.yaml"
    calibration_of.write_calibration(estimated, file)
    assert load_yaml(CameraCalibration, file) == estimated
    assert file.read_text().startswith("# What was measured")
    assert file.stat().st_size < 8000
    assert [path.name for path in file.parent.iterdir()] == ["calibration.yaml"]


def test_a_calibration_says_who_flew(tmp_path, monkeypatch):
    nothing, file = (np.empty(0, dtype=int), np.empty(0), np.empty((0, 4))), tmp_path / "x.yaml"
    hover = {"kind": "hover", "point": [0.0, 0.0, 1.5], "duration": 0.5}
    short = load_scenario(calibration_of.SCENARIO, (*calibration_of.GIVEN_ERRORS, ("planner", hover), ("settle", 0.0)))
    monkeypatch.setattr(calibration_of, "load_scenario", lambda *_: short)
    monkeypatch.setattr(calibration_of, "load_detector", lambda *_: None)
    monkeypatch.setattr(calibration_of, "detect_in_flight", lambda room, width, x, *_: [nothing] * len(x))
    known = known_calibration().model_dump(mode="json")

    def estimated(seen, classes, size, interval, source):
        return validate(CameraCalibration, known | {"source": source | {"landmarks_found": 1}}, "known")

    monkeypatch.setattr(calibration_of, "estimate", estimated)
    assert calibration_of.calibrate([3, 4], file).source.flown_by == "engine"
    assert "flown_by: engine" in file.read_text()
    assert load_calibration(MeasuredErrors()).source.flown_by == ""  # the shipped one was measured before


def test_nothing_found_and_no_seeds_are_refused(tmp_path):
    with pytest.raises(InputError, match="seeds: none given"):
        calibration_of.calibrate([], tmp_path / "x.yaml")
    nothing = (np.empty(0, dtype=int), np.empty(0), np.empty((0, 4)))
    states = np.zeros((40, 12))
    states[:, 2] = 1.5
    seen = sightings(ROOM, 320, [(states, [nothing] * 40)])
    with pytest.raises(InputError, match="fly more"):
        calibration_of.estimate(seen, ROOM.classes, SIZE, 0.1, {})


def test_knot_shares_are_shares():
    W = knot_shares(KNOTS, np.linspace(-2.0, 9.0, 37))
    np.testing.assert_allclose(W.sum(axis=1), 1.0)
    np.testing.assert_allclose(W @ KNOTS, np.clip(np.linspace(-2.0, 9.0, 37), 0.0, 7.0), atol=1e-12)
