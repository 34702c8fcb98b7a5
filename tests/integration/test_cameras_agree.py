"""The projected camera against the rendered one and its detector: fixes as good and as many.

First along the same path, by the same prior; then in closed loop, where fixes make the estimates that boxes are
associated by, and the estimates make the path.
"""

import numpy as np
import pytest

from ortilo_drake.diagrams.wiring.world import sensor_system
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import estimation_mse, nis
from ortilo_drake.model.signals import FIX_SIZE
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.scenario import load_scenario
from ortilo_drake.training.calibration.sightings import detect_in_flight

pytestmark = [pytest.mark.egl, pytest.mark.long]
SEED = 7  # none of those that were calibrated on
EVERY = 9  # ticks: every third picture
POSITION_SD, ATTITUDE_SD = 0.1, 0.003  # of the prior that both get: what a filter knows between fixes [m], [rad]
REALISATIONS = 8  # of the projected camera: its errors last for seconds, so one path holds few independent ones


def fix_errors(scenario, states, messages) -> np.ndarray:
    """The distance of each fix from the truth, NaN where there is none (n) [m]; the prior is the same in every call."""
    system = LandmarkFix(scenario.landmark_fix, scenario.load_room(), scenario.image_width, scenario.h)
    context, rng = system.CreateDefaultContext(), np.random.default_rng(SEED)
    P = np.diag([POSITION_SD**2] * 3 + [ATTITUDE_SD**2] * 3 + [0.0] * 9)
    system.GetInputPort("covariance").FixValue(context, P.ravel())
    errors = np.full(len(states), np.nan)
    for k, (x, message) in enumerate(zip(states, messages, strict=True)):
        xhat = np.concatenate([x, np.zeros(3)])
        xhat[:3] += rng.normal(0.0, POSITION_SD, 3)
        xhat[3:6] += rng.normal(0.0, ATTITUDE_SD, 3)
        system.GetInputPort("detections").FixValue(context, message)
        system.GetInputPort("estimate").FixValue(context, xhat)
        fix = system.GetOutputPort("fix").Eval(context)
        assert fix.shape == (FIX_SIZE,)
        if fix[0] == 1.0:
            errors[k] = np.linalg.norm(fix[2:5] - x[:3])
    return errors


def projected_messages(scenario, states, seed) -> list[np.ndarray]:
    system = sensor_system(scenario, scenario.load_room(), "camera")
    context, messages = system.CreateDefaultContext(), []
    system.set_seed_in(context, seed)
    for k, x in enumerate(states):
        context.SetTime(EVERY * k * scenario.h)
        system.GetInputPort("state").FixValue(context, x)
        messages.append(system.get_output_port().Eval(context).copy())
    return messages


@pytest.fixture(scope="module")
def errors():
    """Fix errors by the rendered camera (n) and by the projected one (REALISATIONS, n)."""
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",), SEED)
    room = scenario.load_room()
    states = fly(scenario)["truth"].values[::EVERY]
    camera = room.camera.scaled_to(scenario.camera.width)
    detect = load_detector(scenario.detector, room, (camera.width, camera.height))
    found = detect_in_flight(room, camera.width, states, detect, lambda: None)
    rendered = [detections_message(0.0, *boxes) for boxes in found]
    projected = [projected_messages(scenario, states, 1000 + k) for k in range(REALISATIONS)]
    return fix_errors(scenario, states, rendered), np.array([fix_errors(scenario, states, m) for m in projected])


def test_fixes_are_as_often_there(errors):
    rendered, projected = errors
    assert np.isfinite(rendered).mean() > 0.5  # there is something to compare
    assert np.isfinite(projected).mean() == pytest.approx(np.isfinite(rendered).mean(), rel=0.25)


def test_fixes_are_as_good(errors):
    rendered, projected = errors
    assert np.nanmedian(projected) == pytest.approx(np.nanmedian(rendered), rel=0.25)
    assert np.sqrt(np.nanmean(projected**2)) == pytest.approx(np.sqrt(np.nanmean(rendered**2)), rel=0.25)


def test_fixes_are_there_in_the_same_places(errors):
    """Where the one camera has fixes the other has, and where the one is blind so is the other."""
    rendered, projected = errors
    share, there = np.isfinite(projected).mean(axis=0), np.isfinite(rendered)
    assert np.mean((share > 0.5) == there) > 0.85
    assert share[there].mean() > 0.75
    assert share[~there].mean() < 0.5


TO = ("planner.goal=[8.0, 0.9]",)  # a third of the way
FLOWN = range(20, 26)  # seeds of the projected flights; the rendered one, the slow one, is the first


def closed_loop(kind: str, seed: int) -> dict[str, float]:
    """Number of fixes, root mean square of their errors and of the estimate's [m], and mean NIS of a flight."""
    flight = fly(load_scenario("nominal_imu_uwb_yolo", (f"camera.kind={kind}", *TO), seed))
    there = flight["arrival"].sel(sensor="camera").values
    fixes = np.stack([flight["measurement"].sel(output=f"{axis}_cam").values[there] for axis in "xyz"], axis=1)
    errors = np.linalg.norm(fixes - flight["truth"].values[there, :3], axis=1)
    return {
        "fixes": float(there.sum()),
        "error": float(np.sqrt(np.mean(errors**2))),
        "estimate": float(np.sqrt(sum(estimation_mse(flight).values()))),
        "nis": float(np.mean(nis(flight, "camera"))),
        "lost": float(flight.attrs["lost"] != "null"),
    }


def test_closed_loops_agree():
    """The rendered flight's figures lie among the projected flights', widened by a fifth of their mean."""
    rendered = closed_loop("rendered", FLOWN[0])
    projected = [closed_loop("projected", seed) for seed in FLOWN]
    for name, value in rendered.items():
        drawn = np.array([figures[name] for figures in projected])
        slack = 0.2 * drawn.mean()
        assert drawn.min() - slack <= value <= drawn.max() + slack, (name, value, drawn)
