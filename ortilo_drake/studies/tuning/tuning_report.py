"""The report of `ortilo tune`."""

from dataclasses import dataclass

from ortilo_drake.studies.tuning.tune import FilterFigures, Tuning


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
