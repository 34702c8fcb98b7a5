"""The report of `ortilo analyze` in at most five lines."""

from ortilo_drake.studies.command_link.command_delay import LONGEST
from ortilo_drake.studies.linearization.linearization_report import LinearizationReport
from ortilo_drake.studies.report.analyze import Analysis, Theory
from ortilo_drake.studies.report.checked_text import least_rates


def analysis_summary(found: Analysis) -> list[str]:
    """Return a summary of an analysis as a Markdown list."""
    lines = (
        _of_theory(found.theory) if found.theory else [f"No theory: {found.no_theory}. Its flights are judged alone."]
    )
    if found.tube and (least := least_rates(found.tube)):
        lines.append(least)
    position = found.honesty.nees.get("position", {}).get("all") if found.honesty else None
    if found.honesty and position is not None:
        lost = f"{found.honesty.lost} of {found.honesty.flights} flights were lost"
        lines.append(f"{lost}; the position's mean NEES is {position.mean:.2f}, 3 if the filter is consistent.")
    return ["## In short", "", *(f"- {line}" for line in lines), ""]


def _of_linearization(found: LinearizationReport) -> str:
    worst = max(abs(value) for matrices in found.agreement.values() for value in matrices.values())
    sensors, states = list(found.unobservable_states.items())[-1]
    seen = f"unseen with {sensors}: {', '.join(states)}" if states else f"with {sensors} every state is seen"
    return f"The loop linearised by Drake equals its closed form to {worst:.0e}; {seen}."


def _of_theory(theory: Theory) -> list[str]:
    lines = [_of_linearization(theory.linearization)] if theory.linearization else []
    margins = theory.margins.get("nominal")
    torque = margins.channels["tau_y"] if margins and margins.channels else None
    if torque and torque.gain_down is not None and torque.gain_up is not None and torque.delay is not None:
        lines.append(
            f"In the torque about y it bears a gain of {torque.gain_down:.2f} to {torque.gain_up:.2f} and "
            f"{1e3 * torque.delay:.0f} ms of delay."
        )
    held = theory.commands.largest_loss["hold"]["independent"]
    late = theory.commands.delay
    how_late = f"{1e3 * late.delay:.0f} ms late" if late else f"{LONGEST} ticks late and more"
    lines.append(f"Of the commands {held:.0%} may be lost if the last one is held, and they may come {how_late}.")
    return lines
