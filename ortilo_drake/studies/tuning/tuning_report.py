"""The report of `ortilo tune`."""

from dataclasses import dataclass
from math import log

from ortilo_drake.studies.tuning.tune import Check, FilterFigures, Tuning


@dataclass(frozen=True)
class UsedFlight:
    """A flight that was fitted to."""

    file: str
    seed: int


@dataclass(frozen=True)
class Number:
    """A fitted number: before, after, its standard errors (None if it stays), and why it stays."""

    before: float
    after: float
    standard_error: float | None
    robust_error: float | None
    stays: str | None


@dataclass(frozen=True)
class Likelihood:
    """The logarithm of the likelihood before and after."""

    before: float
    after: float


@dataclass(frozen=True)
class TuningReport:
    """The result of `ortilo tune`, as --json writes it; see tune.Tuning and fit_noise.NoiseFit."""

    scenario: str
    flights: list[UsedFlight]
    notes: list[str]
    numbers: dict[str, Number]
    counted: tuple[str, ...]
    tilted: float
    log_likelihood: Likelihood
    before: FilterFigures
    after: FilterFigures


def tuning_report(tuning: Tuning) -> TuningReport:
    """Return the report of a tuning."""
    fit = tuning.fit
    numbers = {
        name: Number(
            before=fit.before[name],
            after=fit.values[name],
            standard_error=fit.errors.get(name),
            robust_error=fit.robust_errors.get(name),
            stays=fit.kept.get(name),
        )
        for name in fit.before
    }
    return TuningReport(
        scenario=fit.scenario.name,
        flights=[UsedFlight(file, seed) for file, seed in tuning.used],
        notes=tuning.notes,
        numbers=numbers,
        counted=tuple(fit.counted),
        tilted=fit.tilted,
        log_likelihood=Likelihood(*fit.log_likelihood),
        before=tuning.before,
        after=tuning.after,
    )


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
