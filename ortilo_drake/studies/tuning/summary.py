"""A tuning in at most four lines."""

from math import log

from ortilo_drake.studies.tuning.tune import Check
from ortilo_drake.studies.tuning.tuning_report import TuningReport


def tuning_summary(report: TuningReport, check: Check | None) -> list[str]:
    """Return a summary of a tuning: what changed and what it gained, a line each.

    Args:
        report: of the tuning.
        check: flights anew; None if there were none.
    """
    fitted = {name: number for name, number in report.numbers.items() if number.stays is None}
    changed = {name: n for name, n in fitted.items() if n.before > 0.0 and n.after > 0.0}
    line = f"{len(fitted)} of {len(report.numbers)} numbers were fitted"
    if changed:
        name = max(changed, key=lambda k: abs(log(changed[k].after / changed[k].before)))
        line += f"; changed most: {name}, to {changed[name].after / changed[name].before:.3g} times what it was"
    lines = [line]
    before, after = report.before.nees.get("all"), report.after.nees.get("all")
    if before and after:
        lines.append(f"mean NEES of the position, 3 if consistent: {before.mean:.2f} -> {after.mean:.2f}")
    lines.append(f"mean squared error of the position: {_change(sum(report.before.mse), sum(report.after.mse))}")
    if check:
        line = f"on {len(check.seeds)} new seeds: {check.before.lost} -> {check.after.lost} lost"
        if check.before.mse and check.after.mse:
            line += f", mean squared error {_change(sum(check.before.mse), sum(check.after.mse))}"
        lines.append(line)
    return lines


def _change(before: float, after: float) -> str:
    share = f" ({after / before - 1.0:+.0%})" if before > 0.0 else ""
    return f"{before:.6f} -> {after:.6f} m²{share}"
