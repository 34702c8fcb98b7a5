"""Ranges that err more than the filter believes: a flight warns of them beforehand."""

from ortilo_drake.scenario import Scenario

TOO_MUCH = 1.5  # times the noise that is believed
AT = 5.0  # the distance at which the two are compared [m]


def believed_noise(scenario: Scenario) -> list[str]:
    """A line, which begins with the setting, if the range noise is more than believed and not learned in flight."""
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
    return [f"uwb.noise: {sd:.3g} m at {AT:g} m, but the filter believes {thought:.3g} m; {mend}"]
