"""The flights' part of the report of `ortilo analyze`, as Markdown; the theory is in analysis_text.py."""

from ortilo_drake.sensors.described import title_of
from ortilo_drake.studies.consistency.consistency_flights import DOF
from ortilo_drake.studies.report.analyze import Honesty
from ortilo_drake.studies.tube.tube_report import TubeReport
from ortilo_drake.views.markdown import table


def honesty_text(found: Honesty) -> list[str]:
    """Return the section on consistency and efficiency from analyze.honesty_section."""
    lines = ["## Is the filter honest?", ""]
    lines += [f"{found.flights} flights, {found.lost} lost. Means with 95 % intervals over flights; in brackets"]
    lines += ["what a consistent filter has.", ""]
    rows = []
    for kind, averages, dof in (("NEES", found.nees, DOF), ("NIS", found.nis, {})):
        for name, over in averages.items():
            means = [over[region] for region in ("clear", "blackout", "after", "all")]
            cells = ["-" if mean is None else _mean(mean.mean, mean.interval) for mean in means]
            rows.append([f"{kind} {name} ({dof.get(name, 3)})", *cells])
    lines += table(["", "no blackout near", "in a blackout", "just after one", "whole flight"], rows)
    lines += ["Efficiency, the mean squared error over the Cramér-Rao floor (at best 1):", ""]
    axes = found.efficiency.values()
    ratios = {"all flights": [a.all for a in axes], "tick by tick": [a.ticks for a in axes]}
    if found.lost:
        ratios |= {
            "all flights, with the lost up to their losses": [a.all_with_lost for a in axes],
            "tick by tick, likewise": [a.ticks_with_lost for a in axes],
        }
    rows = [[name, *(_mean(ratio.value, ratio.interval) for ratio in of)] for name, of in ratios.items()]
    return lines + table(["", *found.efficiency], rows)


def _mean(mean: float | None, interval: tuple[float, float] | None) -> str:
    if mean is None:
        return "-"
    return f"{mean:.2f}" + (f" [{interval[0]:.2f}, {interval[1]:.2f}]" if interval else "")


def least_rates(found: TubeReport) -> str:
    """Return from which arrival rates on the tube stays in the corridor; empty if it never does."""
    (first, a), (second, b), (_, margin) = found.rates.items()
    enough = [
        (rate, next((c for c, m in zip(b, row, strict=True) if m >= 0.0), None))
        for rate, row in zip(a, margin, strict=True)
    ]
    least = next(((rate, other) for rate, other in enough if other is not None), None)
    if least is None:
        return ""
    name = title_of(first)
    start = f"The 3-sigma tube stays in the corridor from a {name} rate of {least[0]:.3f} on, with a {second} rate of"
    return f"{start} {least[1]:.3f} there."


def tube_text(found: TubeReport) -> list[str]:
    """Return the section on the tube from tube_report."""
    lines = ["## The tube along the path", ""]
    first, second, _ = found.rates
    bursts = found.bursts
    if least := least_rates(found):
        lines += [least, ""]
    longest = [
        (rate, max((b for b, m in zip(bursts.burst_s, row, strict=True) if m >= 0.0), default=None))
        for rate, row in zip(bursts.rate, bursts.margin, strict=True)
    ]
    rows = [[f"{rate:.2f}", "none" if burst is None else f"{burst:.2f}"] for rate, burst in longest[::2]]
    lines += ["Longest mean burst [s] that keeps it there, by the share of the time that both links are good:", ""]
    lines += table(["rate", "burst"], rows)
    for kind, columns in (("rates", [first, second]), ("bursts", ["rate", "burst [s]"])):
        if not found.flights[kind]:
            continue
        lines += [f"Flown at {kind}: ticks within the predicted radius, and what the linear theory expects of it:", ""]
        rows = [
            [f"{f.at[0]:g}", f"{f.at[1]:g}", f"{f.radius_mean:.2f}", f"{f.margin:.2f}"]
            + [f"{100 * f.contained:.1f} % [{100 * f.contained_low:.1f}, {100 * f.contained_high:.1f}]"]
            + [f"{100 * f.expected:.1f} %", f"{f.lost} of {f.flights}", f.breakdown or "holds"]
            for f in found.flights[kind]
        ]
        header = [*columns, "radius [m]", "margin [m]", "within", "expected", "lost", "the prediction"]
        lines += table(header, rows)
    return lines
