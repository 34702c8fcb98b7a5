"""The report of `ortilo analyze` as Markdown."""

import math

import numpy as np

from ortilo_drake.sensors.described import title_of
from ortilo_drake.studies.arrivals.arrival_map import ArrivalReport
from ortilo_drake.studies.command_link.command_flights import CommandCase, CommandFlights
from ortilo_drake.studies.command_link.command_report import LONGEST, CommandReport
from ortilo_drake.studies.consistency.consistency_flights import DOF
from ortilo_drake.studies.linearization.linearization_report import LinearizationReport
from ortilo_drake.studies.loop.margins import LoopMargins
from ortilo_drake.studies.loop.riccati_report import IllPosed, RiccatiReport, Unsolved
from ortilo_drake.studies.report.analyze import Analysis, Honesty, Theory
from ortilo_drake.studies.tube.tube_report import TubeReport
from ortilo_drake.views.numbers import mean_with_interval, table

SOLVERS = ["drake", "scipy", "doubling", "recursion"]


def _cell(value: float | None, form: str = ".3g") -> str:
    return "-" if value is None or not math.isfinite(value) else format(value, form)


def linearization_text(found: LinearizationReport) -> list[str]:
    """Return the section on linearisation and structure from linearization_report."""
    lines = ["## Linearisation", "", "Largest difference of Drake's matrices from the closed forms at hover:", ""]
    rows = [[part, *(f"{d[M]:.1e}" for M in "ABCD")] for part, d in found.agreement.items()]
    lines += table(["part", "A", "B", "C", "D"], rows)
    flown = ", ".join(f"{value:.1e} in a tick with {which}" for which, value in found.flown.items())
    lines += [f"The diagram that flies, one tick of it by AutoDiffXd, differs from the closed loop by {flown}.", ""]
    radius = {part: max(abs(z) for z in values) for part, values in found.eigenvalues.items()}
    blocks = "; ".join(f"{value:g} in blocks of {', '.join(map(str, sizes))}" for value, sizes in found.jordan_blocks)
    lines += [
        f"Eigenvalues of Phi: {blocks}. Uncontrollable modes: {len(found.uncontrollable_modes) or 'none'}. "
        + "Spectral radii: "
        + ", ".join(f"{part.replace('_', ' ')} {r:.5f}" for part, r in radius.items() if part != "plant")
        + ".",
        "",
        f"What no sensor sees, and the observability Gramian over {found.gramians.horizon:g} s:",
        "",
    ]
    rows = [
        [subset, ", ".join(states) or "nothing", _cell(found.gramians.observability[subset].condition)]
        for subset, states in found.unobservable_states.items()
    ]
    return lines + table(["sensors there", "unobservable states", "condition number"], rows)


def riccati_text(found: RiccatiReport) -> list[str]:
    """Return the section on the Riccati equations from riccati_report."""
    lines = ["## Riccati equations", "", "Relative residual of each solver, and what the solution does:", ""]
    header = ["equation", *SOLVERS, "spectral radius", "to instability", "condition"]
    rows, notes = [], []
    of_servo = {"servo": found.servo} if found.servo else {}
    for name, solutions in {**of_servo, **{f"filter {s}": f for s, f in found.filter.items()}}.items():
        if isinstance(solutions, IllPosed):
            notes.append(f"- {name}: {solutions.error}")
            continue
        notes += [f"- {name}, {solver}: {s.note}" for solver, s in solutions.items() if s.note]
        best = solutions["doubling"]
        figures = ["-"] * 3
        if not isinstance(best, Unsolved):
            figures = [f"{best.spectral_radius:.5f}", _cell(best.distance_to_instability), _cell(best.condition)]
        solved = [solutions[solver] for solver in SOLVERS]
        residuals = [None if isinstance(s, Unsolved) else s.residual for s in solved]
        rows.append([name, *(_cell(residual, ".1e") for residual in residuals), *figures])
    lines += [*table(header, rows), *dict.fromkeys(notes), "", "Left to themselves, on ill-posed problems:", ""]
    rows = [
        [case, *(getattr(what, solver).outcome for solver in SOLVERS), (what.error or "").replace("|", "/")]
        for case, what in found.ill_posed.items()
    ]
    return lines + table(["problem", *SOLVERS, "what we say"], rows)


def margins_text(found: dict[str, LoopMargins]) -> list[str]:
    """Return the section on the loop's margins from margins_report."""
    lines = ["## Margins at the plant's input", "", "Torque about y; the last two: all at once, scaled by R.", ""]
    rows = []
    for case, margins in found.items():
        y, joint = margins.channels and margins.channels["tau_y"], margins.joint
        if not y or not joint:
            rows.append([case, *["-"] * 7])
            continue
        gain = f"{_cell(y.gain_down, '.2f')} to {_cell(y.gain_up, '.2f')}"
        delay = "-" if y.delay is None else f"{1e3 * y.delay:.0f} ms"
        rows.append(
            [case, gain, _cell(y.phase, ".2f"), delay, _cell(y.delay_ticks, ".2f"), f"{y.sensitivity:.2f}"]
            + [f"{joint.sensitivity:.2f}", f"{joint.disk.gain_low:.2f} to {_cell(joint.disk.gain_high, '.2f')}"]
        )
    header = ["loop", "gain", "phase [rad]", "delay", "in ticks", "peak of S", "joint peak of S", "joint disk gain"]
    notes = [f"- {case}: {margins.note}" for case, margins in found.items() if margins.note]
    return [*lines, *table(header, rows), *notes, ""]


def arrivals_text(found: ArrivalReport) -> list[str]:
    """Return the section on arrival rates from arrival_report: standard deviations in x."""
    lines = ["## Arrival rates", "", found.critical_rate.sentence, ""]
    lines += ["Standard deviation of x from the bounds of the expected Riccati equation (lower to upper) [m]:", ""]
    columns = range(0, len(found.rates_camera), max(len(found.rates_camera) // 5, 1))
    rows = []
    for i in range(0, len(found.rates_uwb), max(len(found.rates_uwb) // 5, 1)):
        cells = []
        for j in columns:
            low, high = found.lower[i, j, 0], found.upper[i, j, 0]
            cells.append(f"{low**0.5:.4f} to {high**0.5:.4f}" if math.isfinite(high) else "unbounded")
        rows.append([f"{found.rates_uwb[i]:.2f}", *cells])
    return lines + table(["uwb \\ camera", *(f"{found.rates_camera[j]:.2f}" for j in columns)], rows)


def commands_text(found: CommandReport, flown: CommandFlights | None) -> list[str]:
    """Return the section on lost and late commands from command_report and command_flights."""
    lines = ["## Lost and late commands", ""]
    rows = [
        [strategy, *(_cell(share, ".2f") for share in largest.values())]
        for strategy, largest in found.largest_loss.items()
    ]
    kinds = [kind.replace("_", " ") + " ticks" * kind.startswith("bursts") for kind in found.largest_loss["hold"]]
    lines += ["Largest share of lost commands at which the second moment stays bounded:", ""]
    lines += table(["when lost", *kinds], rows)
    lines += _acknowledged_text(found)
    how_late = f"{LONGEST} ticks late and more: filter and servo account for it."
    if late := found.delay:
        how_late = f"{late.ticks:.2f} ticks ({1e3 * late.delay:.0f} ms) late. With {late.whole_ticks} whole ticks"
        how_late += f" these grow: {late.modes}."
    lines += [f"Commands may come {how_late}", ""]
    if flown is not None:
        lines += [f"Flown: hovering {flown.duration:g} s, {len(flown.seeds)} seeds each, by {flown.flown_by}.", ""]
        header = ["link", "growth a tick", "predicted rms [m]", "flown rms [m]", "flights lost", "as predicted"]
        lines += table(header, [_case_row(case) for case in flown.cases])
    return lines


def _acknowledged_text(found: CommandReport) -> list[str]:
    """Return the text on acknowledged commands and the gain that is best for their losses."""
    lines = [
        "If commands that arrive were acknowledged and lost ones zero, the LQG gain for the share lost"
        f" (Schenato et al., 2007) would bear every share below {found.acknowledged_loss:.2f}.",
        "",
    ]
    if not found.acknowledged_rms:
        return lines
    by_gain = found.rms | {"acknowledged, best gain": found.acknowledged_rms}
    rows = [[name, *map(_cell, by_loss.values())] for name, by_loss in by_gain.items()]
    lines += ["Predicted rms distance from the reference [m]:", ""]
    return lines + table(["share lost", *found.acknowledged_rms], rows)


def _case_row(case: CommandCase) -> list[str]:
    link = case.link.model_dump(mode="json")
    loss = {k: v for k, v in link["loss"].items() if k != "kind"}
    what = f"{link['delay']} ticks late" if link["delay"] else f"loss {loss or 0}, {link['when_lost']}"
    return (
        [what.replace("{", "").replace("}", "").replace("'", ""), f"{case.growth:.4f}"]
        + [_cell(case.predicted_rms), _cell(case.flown_rms), f"{case.lost} of {case.flights}"]
        + ["yes" if case.agrees else "no"]
    )


def honesty_text(found: Honesty) -> list[str]:
    """Return the section on consistency and efficiency from analyze.honesty_section."""
    lines = ["## Is the filter honest?", ""]
    lines += [f"{found.flights} flights, {found.lost} lost, flown by {found.flown_by}."]
    lines += ["Means with 95 % intervals over flights; in brackets what a consistent filter has.", ""]
    rows = []
    for kind, averages, dof in (("NEES", found.nees, DOF), ("NIS", found.nis, {})):
        for name, over in averages.items():
            means = [over[region] for region in ("clear", "blackout", "after", "all")]
            cells = ["-" if mean is None else mean_with_interval(mean.mean, mean.interval) for mean in means]
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
    rows = [[name, *(mean_with_interval(ratio.value, ratio.interval) for ratio in of)] for name, of in ratios.items()]
    return lines + table(["", *found.efficiency], rows)


def least_rates(found: TubeReport) -> str:
    """Return a sentence with the least arrival rates that keep the tube in the corridor; empty if none do."""
    (first, a), (second, b), (_, margin) = found.rates.items()
    enough = np.argwhere(np.asarray(margin) >= 0.0)  # in the order of the first rate, then of the second
    if not len(enough):
        return ""
    i, j = enough[0]
    start = f"The 3-sigma tube stays in the corridor from a {title_of(first)} rate of {a[i]:.3f} on, with a"
    return f"{start} {second} rate of {b[j]:.3f} there."


def tube_text(found: TubeReport) -> list[str]:
    """Return the section on the tube from tube_report."""
    lines = ["## The tube along the path", ""]
    (first, second, _), (rates, lengths, margins) = found.rates, found.bursts.values()
    if least := least_rates(found):
        lines += [least, ""]
    longest = [
        (rate, max((b for b, m in zip(lengths, row, strict=True) if m >= 0.0), default=None))
        for rate, row in zip(rates, margins, strict=True)
    ]
    rows = [[f"{rate:.2f}", "none" if burst is None else f"{burst:.2f}"] for rate, burst in longest[::2]]
    lines += ["Longest mean burst [s] that keeps it there, by the share of the time that both links are good:", ""]
    lines += table(["rate", "burst"], rows)
    for kind, columns in (("rates", [first, second]), ("bursts", ["rate", "burst [s]"])):
        if not found.flights[kind]:
            continue
        lines += [
            f"Flown at {kind} by {found.flown_by}: ticks within the predicted radius, and what linear theory expects:",
            "",
        ]
        rows = [
            [f"{f.at[0]:g}", f"{f.at[1]:g}", f"{f.radius_mean:.2f}", f"{f.margin:.2f}"]
            + [f"{100 * f.contained:.1f} % [{100 * f.contained_low:.1f}, {100 * f.contained_high:.1f}]"]
            + [f"{100 * f.expected:.1f} %", f"{f.lost} of {f.flights}", f.breakdown or "holds"]
            for f in found.flights[kind]
        ]
        header = [*columns, "radius [m]", "margin [m]", "within", "expected", "lost", "the prediction"]
        lines += table(header, rows)
    return lines


def _world_text(found: Analysis) -> str:
    """Return a line that says which of the world's settings the theory includes."""
    text = "The theory is of the world that the filter believes"
    if found.in_rms_alone:
        text += f"; the rms predicted at hover has besides: {', '.join(found.in_rms_alone)}"
    if found.left_out:
        text += f"; not in it: {', '.join(found.left_out)}"
    if "world.rotors" in (found.left_out or ()):
        text += ": `ortilo scenario check` tests the loop with the rotors' lag"
    return text + "."


def analysis_text(found: Analysis) -> str:
    """Return an analysis as Markdown."""
    lines = [f"# Analysis of {found.scenario}", "", *analysis_summary(found)]
    if found.left_out or found.in_rms_alone:
        lines += [_world_text(found), ""]
    if theory := found.theory:
        lines += linearization_text(theory.linearization) if theory.linearization else []
        lines += riccati_text(theory.riccati) + margins_text(theory.margins)
        lines += arrivals_text(theory.arrivals) + commands_text(theory.commands, found.command_flights)
    if found.tube:
        lines += tube_text(found.tube)
    elif theory:
        lines += ["## The tube along the path", "", f"Not predicted: {found.no_tube}.", ""]
    if found.honesty:
        lines += honesty_text(found.honesty)
    return "\n".join(lines).rstrip() + "\n"


def analysis_summary(found: Analysis) -> list[str]:
    """Return a summary of an analysis as a Markdown list."""
    lines = [f"No theory: {found.no_theory}. Its flights are judged alone."]
    if found.theory:
        lines = _of_theory(found.theory)
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
