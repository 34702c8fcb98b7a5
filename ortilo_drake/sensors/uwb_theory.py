"""The theory of the ranges: their unknown errors, the errors of a fix, and the survey error that a bank learns.

A warning before the flight says where the ranges have more noise than the filter's settings.
"""

from math import isclose

import numpy as np

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.ranging.multilateration import fix_message_at
from ortilo_drake.onboard.ranging.survey_bank import MEMORY
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, VARIANCE
from ortilo_drake.sensors.information_uwb import between, range_rows
from ortilo_drake.sensors.learned_survey import residual_information, scale_learned, share_learned, with_biases
from ortilo_drake.sensors.mismatch import Mismatch, of_truth
from ortilo_drake.sensors.unknown_error import (
    Error,
    Made,
    Seen,
    along_position,
    derivative,
    gauss_markov,
    one_per_source,
    spread,
    walk,
)
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.fitted_uwb import noise_of
from ortilo_drake.world.sensors.uwb import receiver_of, uwb_message

STEP = 1e-4  # step of the finite differences [m]
TOO_MUCH = 1.5  # ratio of the true noise to the filter's above which the flight warns
AT = 5.0  # distance at which the two are compared [m]
MISMATCHES = (
    Mismatch("range biases of sd [cm]", of_truth("uwb.bias_sd", 0.01), 5.0, (5.0,), 160.0),
    Mismatch("anchors surveyed to sd [cm]", of_truth("survey.anchors_sd", 0.01), 3.0, (5.0,), 160.0),
)


def message_without_noise(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray:
    """Return the uwb message at state x (12), with ranges without noise and the effect of the scenario's walls."""
    receiver = receiver_of(scenario.uwb, room)._replace(s_0=0.0, s_1=0.0)
    message = np.asarray(uwb_message(x, receiver, 0, stream_id("uwb"), 0.0, scenario.h))
    if scenario.belief.uwb.behind_walls == "left_out":
        n = len(room.anchors)
        for i, anchor in enumerate(room.anchor_positions):
            if walls_crossed(x[:3], anchor, room.wall_boxes):
                message[PAYLOAD + i] = message[PAYLOAD + n + i] = 0.0
    return message


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return the unknown errors of the ranges and of the anchors' positions.

    An error common to all ranges cancels in differences. For differences an anchor's position error counts as a
    constant error of its ranges, which is the best that can be known.
    """
    uwb, survey, n = scenario.truth.uwb, scenario.truth.survey, len(room.anchor_positions)
    differ = scenario.uwb.kind == "differences"
    its = between(n) if differ else one_per_source(n)
    common = walk(spread(uwb.bias, number=1), 0.0, {"uwb": lambda rows: np.ones((len(rows), 1))})
    surveyed = walk(spread(survey.anchors_sd, number=3 * n), 0.0, {"uwb": along_position(-1.0, n)})
    if differ:
        surveyed = walk(spread(survey.anchors_sd, number=n), 0.0, {"uwb": its})
    return [
        *unknown_fitted(scenario, n, its),
        *([] if differ else [common]),
        walk(spread(uwb.bias_sd, number=n), 0.0, {"uwb": its}),
        gauss_markov(spread(uwb.slow_sd, number=n), uwb.slow_time, scenario.h, {"uwb": its}),
        walk(spread(survey.anchors), 0.0, {"uwb": along_position(-1.0)}),
        surveyed,
    ]


def unknown_fitted(scenario: Scenario, n: int, its: Seen) -> list[Error]:
    """Return n anchors' unknown fitted errors; an error field counts as constant, the best that can be known."""
    if scenario.uwb.errors != "fitted":
        return []
    noise = noise_of(scenario.uwb)
    constant = 0.0 if noise.field is None else noise.field.sd
    if noise.constants is None:
        constant = float(np.hypot(constant, noise.constants_sd))
    found = [walk(spread(constant, number=n), 0.0, {"uwb": its})]
    if noise.lasting is not None:
        found.append(gauss_markov(spread(noise.lasting.sd, number=n), noise.lasting.time, scenario.h, {"uwb": its}))
    return found


def made(scenario: Scenario, room: Room, x: np.ndarray) -> Made:
    """Return D (3, l) of the multilateration at state x (12), and the ranges' rows (l, 17)."""
    anchors, ranges = room.anchor_positions, message_without_noise(scenario, room, x)
    rows = range_rows(scenario.uwb, room, x[np.newaxis], np.ones(1, dtype=bool))
    rows = rows[ranges[PAYLOAD + len(anchors) :][rows[:, SOURCE].astype(int)] > 0.0]

    def fix(message: np.ndarray) -> np.ndarray:
        return fix_message_at(scenario.multilateration, anchors, message, x)[PAYLOAD : PAYLOAD + 3]

    return derivative(fix, ranges, PAYLOAD + rows[:, SOURCE].astype(int), STEP), rows


def learned(scenario: Scenario, room: Room, x: np.ndarray) -> Scenario:
    """Return the scenario with the survey error and the noise of ranges that the filter learns at state x (12)."""
    settings, uwb, survey = scenario.multilateration, scenario.truth.uwb, scenario.truth.survey
    if settings.noise_scale is None and settings.bias_bank is None:
        return scenario
    _, rows = made(scenario, room, x)
    J, variances = rows[:, GRADIENT][:, :3], rows[:, VARIANCE]
    if settings.noise_scale is not None:
        distances = np.linalg.norm(room.anchor_positions[rows[:, SOURCE].astype(int)] - x[:3], axis=1)
        believed, true = ((s_0 + s_1 * distances) ** 2 for s_0, s_1 in (settings.noise.sds, scenario.uwb.sds))
        c = scale_learned(J, believed, true)
        told = {name: c * sd for name, sd in settings.noise if name != "kind"}
        noise = settings.noise.model_copy(update=told)
        settings = settings.model_copy(update={"noise": noise, "noise_scale": None})
        scenario = scenario.model_copy(update={"multilateration": settings})
    if settings.bias_bank is None:
        return scenario
    M = residual_information(J, variances)
    fixes = MEMORY / (scenario.every("uwb") * scenario.h)
    n = len(room.anchors)
    fitted = [error.sd[0] for error in unknown_fitted(scenario, n, one_per_source(n))]
    lasts = (uwb.bias, uwb.bias_sd, uwb.slow_sd, survey.anchors_sd, *fitted)
    s = settings.bias_sd
    s *= share_learned(np.array(settings.bias_bank), s, fixes * np.linalg.eigvalsh(M), float(np.linalg.norm(lasts)))
    settings = settings.model_copy(update={"bias_bank": None, "bias_sd": s})
    scenario = scenario.model_copy(update={"multilateration": settings})
    D, rows = made(scenario, room, x)
    return with_biases(scenario, uwb_sd=tuple(s * np.linalg.norm(D, axis=1)))


def is_as_believed(scenario: Scenario) -> bool:
    """Return whether the ranges' noise equals the filter's, up to a scale factor if the filter learns it."""
    fix, (s_0, s_1), (b_0, b_1) = scenario.multilateration, scenario.uwb.sds, scenario.multilateration.noise.sds
    return (s_0, s_1) == (b_0, b_1) or (fix.noise_scale is not None and isclose(s_0 * b_1, s_1 * b_0))


def left_out(scenario: Scenario) -> tuple[dict[str, bool], dict[str, bool]]:
    """Return the settings that the predicted rms neglects, and those that only it includes; see model/parts.py."""
    uwb = scenario.uwb
    noise = uwb.fitted if uwb.errors == "fitted" else None
    out = {"uwb.round": uwb.round > 0.0, "uwb.walls": uwb.walls.kind in ("bias", "excess")}
    out["uwb.noise" if noise is None else "uwb.fitted.white"] = not is_as_believed(scenario)
    if noise is None:
        return out, {}
    return out | {
        "uwb.fitted.outliers": noise.outliers.share > 0.0 and noise.outliers.sd > 0.0,
        "uwb.fitted.freedom": noise.freedom is not None,
        "uwb.fitted.constants": any(noise.constants or ()),
        "uwb.fitted.near_floor": noise.near_floor > 0.0,
        "uwb.fitted.missing": noise.missing > 0.0,
    }, {
        "uwb.fitted.lasting": noise.lasting is not None and noise.lasting.sd > 0.0,
        "uwb.fitted.field": noise.field is not None and noise.field.sd > 0.0,
        "uwb.fitted.constants_sd": noise.constants is None and noise.constants_sd > 0.0,
    }


def believed_noise(scenario: Scenario) -> list[str]:
    """Return a line, which begins with the setting, if the range noise exceeds the filter's and is not learned."""
    solver, ranges = scenario.multilateration, getattr(scenario.estimator, "ranges", None)
    key, believed = "multilateration.noise", solver.noise
    if scenario.estimator.kind == "tight" and ranges is not None:
        key, believed = "estimator.ranges.noise", ranges.noise
    elif solver.noise_scale is not None:
        return []
    if not scenario.measures_ranges or scenario.uwb.errors != "white":
        return []
    (s_0, s_1), (b_0, b_1) = scenario.uwb.noise.sds, believed.sds
    sd, thought = s_0 + s_1 * AT, b_0 + b_1 * AT
    if sd <= TOO_MUCH * thought:
        return []
    mend = f"give {key} the same"
    if believed is solver.noise and solver.method == "least_squares" and solver.exclude is None:
        mend += ", or let --set multilateration.noise_scale=10 learn it"
    return [f"uwb.noise: {sd:.3g} m at {AT:g} m, but the filter assumes {thought:.3g} m; {mend}"]
