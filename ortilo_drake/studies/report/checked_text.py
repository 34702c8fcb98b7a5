"""The flights' part of the report of `ortilo analyze`, as Markdown; the theory is in analysis_text.py."""

from typing import Any

from ortilo_drake.studies.consistency.consistency_flights import DOF
from ortilo_drake.views.markdown import table


def honesty_text(found: dict[str, Any]) -> list[str]:
    """Return the section on consistency and efficiency from analyze.honesty_section."""
    lines = ["## Is the filter honest?", ""]
    lines += [f"{found['flights']} flights, {found['lost']} lost. Means with 95 % intervals over flights; in brackets"]
    lines += ["what a consistent filter has.", ""]
    rows = []
    for kind, dof in (("nees", DOF), ("nis", {})):
        for name, over in found[kind].items():
            cells = [_mean(over[region]) for region in ("clear", "blackout", "after", "all")]
            rows.append([f"{kind.upper()} {name} ({dof.get(name, 3)})", *cells])
    lines += table(["", "no blackout near", "in a blackout", "just after one", "whole flight"], rows)
    lines += ["Efficiency, the mean squared error over the Cramér-Rao floor (at best 1):", ""]
    rows = [
        [name, *(_mean({"mean": axis[key]["value"], "interval": axis[key]["interval"]}) for axis in axes)]
        for axes in [list(found["efficiency"].values())]
        for name, key in (("all flights", "all"), ("tick by tick", "ticks"))
    ]
    return lines + table(["", *found["efficiency"]], rows)


def _mean(found: dict[str, Any] | None) -> str:
    if found is None or found["mean"] is None:
        return "-"
    interval = found["interval"]
    return f"{found['mean']:.2f}" + (f" [{interval[0]:.2f}, {interval[1]:.2f}]" if interval else "")


def tube_text(found: dict[str, Any]) -> list[str]:
    """Return the section on the tube from analyze.tube_section."""
    lines = ["## The tube along the path", ""]
    rates = found["rates"]
    enough = [
        (uwb, next((c for c, m in zip(rates["camera"], row, strict=True) if m is not None and m >= 0.0), None))
        for uwb, row in zip(rates["uwb"], rates["margin"], strict=True)
    ]
    least = next(((uwb, camera) for uwb, camera in enough if camera is not None), None)
    if least is not None:
        lines += [f"The 3-sigma tube stays in the corridor from a UWB rate of {least[0]:.3f} on, with a camera rate of"]
        lines += [f"{least[1]:.3f} there.", ""]
    longest = [
        (
            rate,
            max(
                (b for b, m in zip(found["bursts"]["burst_s"], row, strict=True) if m is not None and m >= 0.0),
                default=None,
            ),
        )
        for rate, row in zip(found["bursts"]["rate"], found["bursts"]["margin"], strict=True)
    ]
    rows = [[f"{rate:.2f}", "none" if burst is None else f"{burst:.2f}"] for rate, burst in longest[::2]]
    lines += ["Longest mean burst [s] that keeps it there, by the share of the time that both links are good:", ""]
    lines += table(["rate", "burst"], rows)
    for kind, columns in (("rates", ["uwb", "camera"]), ("bursts", ["rate", "burst [s]"])):
        if not found["flights"][kind]:
            continue
        lines += [f"Flown at {kind}: ticks within the predicted radius, and what the linear theory expects of it:", ""]
        rows = [
            [f"{f['at'][0]:g}", f"{f['at'][1]:g}", f"{f['radius_mean']:.2f}", f"{f['margin']:.2f}"]
            + [f"{100 * f['contained']:.1f} % [{100 * f['contained_low']:.1f}, {100 * f['contained_high']:.1f}]"]
            + [f"{100 * f['expected']:.1f} %", f"{f['lost']} of {f['flights']}", f["breakdown"] or "holds"]
            for f in found["flights"][kind]
        ]
        header = [*columns, "radius [m]", "margin [m]", "within", "expected", "lost", "the prediction"]
        lines += table(header, rows)
    return lines
