"""The warning, before a flight, about ranges with more noise than the filter's settings have."""

from ortilo_drake.scenario import Scenario

TOO_MUCH = 1.5  # ratio of the true noise to the filter's above which the flight warns
AT = 5.0  # distance at which the two are compared [m]


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
    return [f"uwb.noise: {sd:.3g} m at {AT:g} m, but the filter believes {thought:.3g} m; {mend}"]
