"""What `ortilo tune FOLDERS --map` prints: how much was fitted, and what the rest of the motions says of it."""

from ortilo_drake.studies.recorded.fit_noise import FITTED, Fitted
from ortilo_drake.studies.recorded.held_out import Gain, HeldOut

CONSISTENT, RISEN = 3.0, 1.3  # mean NEES of honest deviations; a rise by less is not told

NAMES = {
    "innovations": "likelihood of the ranges",
    "errors": "likelihood of the errors",
    "accuracy": "position error",
}


def fitted_lines(fitted: Fitted) -> list[str]:
    """Return the figures of the fitted and of the held-out part, before and after, and the verdict, line by line."""
    held = fitted.judged
    chance = "" if fitted.chance is None else f"; {len(FITTED)} numbers gain {fitted.chance:.1f} by chance"
    lines = [
        f"fitted to {fitted.ranges} ranges in {fitted.fitted_time:.1f} s: log-likelihood {fitted.before:.1f} -> "
        f"{fitted.after:.1f}, computed {fitted.computed} times{chance}",
        *(f"note: {note}" for note in fitted.notes),
        f"on the {held.duration:.1f} s that were not fitted, before -> after, changes with intervals (95 % for all):",
        f"  log-likelihood of the ranges    {_gain(held.gains['innovations'])}",
        f"  NIS (1 if consistent)           {held.nis[0]:.2f} -> {held.nis[1]:.2f}",
    ]
    if held.nees is not None and held.rmse is not None:
        before, after = (", ".join(f"{axis:.3f}" for axis in one) for one in held.rmse)
        lines += [
            f"  log-likelihood of the errors    {_gain(held.gains['errors'])}",
            f"  NEES (3 if consistent)          {held.nees[0]:.2f} -> {held.nees[1]:.2f}",
            f"  RMS error in x, y, z            {before} -> {after} m",
            f"  mean square error               {_mean_square(held.gains['accuracy'])}",
        ]
    return [*lines, verdict_line(fitted)]


def verdict_line(fitted: Fitted) -> str:
    """Return in a sentence whether the tuned noise is better where it was not fitted, and what to do."""
    held = fitted.judged
    if fitted.verdict == "mend first":
        return "mend these first; the noise may only have been fitted to them:" + "".join(
            f"\n  {doubt}" for doubt in fitted.doubts
        )
    better, worse = (
        ", ".join(NAMES[name] for name, gain in held.gains.items() if gain.sign == sign) for sign in (1, -1)
    )
    if fitted.verdict == "better":
        return f"the tuned noise is better there ({better}): use it{_claims(held)}"
    if fitted.verdict == "worse":
        return f"the tuned noise is worse there ({worse}): keep the map that you had"
    if fitted.verdict == "mixed":
        return (
            f"the tuned noise is worse there in one respect ({worse}), better in another ({better}): keep the map that "
            "you had, unless the other matters more to you"
        )
    if held.verdict == "better":
        return "what was fitted gains no more than by chance, whatever the rest gains: keep the map that you had"
    return "the tuned noise is no better there, the same within its uncertainty: keep the map that you had"


def _claims(held: HeldOut) -> str:
    """Return a warning where NEES rises above 3: the likelihood of the ranges does not see the calibration's errors."""
    if held.nees is None or held.nees[1] <= RISEN * max(CONSISTENT, held.nees[0]):
        return ""
    times = (held.nees[1] / CONSISTENT) ** 0.5
    return f"; but NEES rises to {held.nees[1]:.1f}: errors are {times:.1f} times what its standard deviations claim"


def _gain(gain: Gain) -> str:
    return f"{gain.before:.1f} -> {gain.after:.1f}: {gain.after - gain.before:+.1f} ± {gain.half:.1f}"


def _mean_square(gain: Gain) -> str:
    """Return a gain whose sums are negative mean squares [m²], as the mean squares that they are."""
    return f"{-gain.before:.5f} -> {-gain.after:.5f} m²: {gain.before - gain.after:+.5f} ± {gain.half:.5f}"
