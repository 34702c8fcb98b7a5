"""The report of `ortilo analyze` as Markdown."""

from typing import Any

from ortilo_drake.studies.report.checked_text import honesty_text, tube_text
from ortilo_drake.views.markdown import table


def _cell(value: float | None, form: str = ".3g") -> str:
    return "-" if value is None else format(value, form)


def linearization_text(found: dict[str, Any]) -> list[str]:
    """Return the section on linearisation and structure from linearization_report."""
    lines = ["## Linearisation", "", "Largest difference of Drake's matrices from the closed forms at hover:", ""]
    rows = [[part, *(f"{d[M]:.1e}" for M in "ABCD")] for part, d in found["agreement"].items()]
    lines += table(["part", "A", "B", "C", "D"], rows)
    flown = ", ".join(f"{value:.1e} in a tick with {which}" for which, value in found["flown"].items())
    lines += [f"The diagram that flies, differenced over one tick, differs from the closed loop by {flown}.", ""]
    radius = {part: max(abs(complex(*z)) for z in values) for part, values in found["eigenvalues"].items()}
    blocks = "; ".join(
        f"{value:g} in blocks of {', '.join(map(str, sizes))}" for value, sizes in found["jordan_blocks"]
    )
    lines += [
        f"Eigenvalues of Phi: {blocks}. Uncontrollable modes: {len(found['uncontrollable_modes']) or 'none'}. "
        + "Spectral radii: "
        + ", ".join(f"{part.replace('_', ' ')} {r:.5f}" for part, r in radius.items() if part != "plant")
        + ".",
        "",
        f"What no sensor sees, and the observability Gramian over {found['gramians']['horizon']:g} s:",
        "",
    ]
    rows = [
        [subset, ", ".join(states) or "nothing", _cell(found["gramians"]["observability"][subset]["condition"])]
        for subset, states in found["unobservable_states"].items()
    ]
    return lines + table(["sensors there", "unobservable states", "condition number"], rows)


def riccati_text(found: dict[str, Any]) -> list[str]:
    """Return the section on the Riccati equations from riccati_report."""
    lines = ["## Riccati equations", "", "Relative residual of each solver, and what the solution does:", ""]
    header = ["equation", "drake", "scipy", "doubling", "recursion", "spectral radius", "to instability", "condition"]
    rows, notes = [], []
    for name, solutions in {"servo": found["servo"], **{f"filter {s}": f for s, f in found["filter"].items()}}.items():
        if "error" in solutions:
            notes.append(f"- {name}: {solutions['error']}")
            continue
        best = solutions["doubling"]
        residuals = [f"{solutions[solver]['residual']:.1e}" for solver in header[1:5]]
        figures = [f"{best['spectral_radius']:.5f}", _cell(best["distance_to_instability"]), _cell(best["condition"])]
        rows.append([name, *residuals, *figures])
        notes += [f"- {name}, {solver}: {s['note']}" for solver, s in solutions.items() if s["note"]]
    lines += [*table(header, rows), *dict.fromkeys(notes), "", "Left to themselves, on ill-posed problems:", ""]
    rows = [
        [case, *(what[solver]["outcome"] for solver in header[1:5]), what["error"].replace("|", "/")]
        for case, what in found["ill_posed"].items()
    ]
    return lines + table(["problem", *header[1:5], "what we say"], rows)


def margins_text(found: dict[str, Any]) -> list[str]:
    """Return the section on the loop's margins from margins_report."""
    lines = [
        "## Margins at the plant's input",
        "",
        "Torque about y; the last two: all at once, scaled by R.",
        "",
    ]
    rows = []
    for case, margins in found.items():
        y = margins["channels"] and margins["channels"]["tau_y"]
        if not y:
            rows.append([case, *["-"] * 7])
            continue
        gain = f"{_cell(y['gain_down'], '.2f')} to {_cell(y['gain_up'], '.2f')}"
        delay = f"{1e3 * y['delay']:.0f} ms", f"{y['delay_ticks']:.2f}"
        joint = margins["joint"]
        rows.append(
            [case, gain, f"{y['phase']:.2f}", *delay, f"{y['sensitivity']:.2f}"]
            + [f"{joint['sensitivity']:.2f}", f"{joint['disk']['gain_low']:.2f} to {joint['disk']['gain_high']:.2f}"]
        )
    header = ["loop", "gain", "phase [rad]", "delay", "in ticks", "peak of S", "joint peak of S", "joint disk gain"]
    notes = [f"- {case}: {margins['note']}" for case, margins in found.items() if margins["note"]]
    return [*lines, *table(header, rows), *notes, ""]


def arrivals_text(found: dict[str, Any]) -> list[str]:
    """Return the section on arrival rates from arrival_report: standard deviations in x."""
    lines = ["## Arrival rates", "", found["critical_rate"]["sentence"], ""]
    lines += ["Standard deviation of x from the bounds of the expected Riccati equation (lower to upper) [m]:", ""]
    chosen = [
        found["rates_camera"].index(rate) for rate in found["rates_camera"][:: max(len(found["rates_camera"]) // 5, 1)]
    ]
    rows = []
    for i, rate in list(enumerate(found["rates_uwb"]))[:: max(len(found["rates_uwb"]) // 5, 1)]:
        cells = []
        for j in chosen:
            low, high = found["lower"][i][j][0], found["upper"][i][j][0]
            cells.append("unbounded" if high is None else f"{low**0.5:.4f} to {high**0.5:.4f}")
        rows.append([f"{rate:.2f}", *cells])
    return lines + table(["uwb \\ camera", *(f"{found['rates_camera'][j]:.2f}" for j in chosen)], rows)


def commands_text(found: dict[str, Any], flown: dict[str, Any] | None) -> list[str]:
    """Return the section on lost and late commands from command_report and command_flights."""
    lines = ["## Lost and late commands", ""]
    rows = [
        [strategy, *(_cell(share, ".2f") for share in largest.values())]
        for strategy, largest in found["largest_loss"].items()
    ]
    kinds = [kind.replace("_", " ") + " ticks" * kind.startswith("bursts") for kind in found["largest_loss"]["hold"]]
    lines += ["Largest share of lost commands at which the second moment stays bounded:", ""]
    lines += table(["when lost", *kinds], rows)
    late = found["delay"]
    lines += [f"Commands may come {late['ticks']:.2f} ticks ({1e3 * late['delay']:.0f} ms) late. With", ""]
    lines[-2] += f" {late['whole_ticks']} whole ticks these grow: {late['modes']}."
    if flown is not None:
        lines += [f"Flown: hovering {flown['duration']:g} s, {len(flown['seeds'])} seeds each.", ""]
        rows = []
        for case in flown["cases"]:
            link = case["link"]
            loss = {k: v for k, v in link["loss"].items() if k != "kind"}
            what = f"{link['delay']} ticks late" if link["delay"] else f"loss {loss or 0}, {link['when_lost']}"
            rows.append(
                [what.replace("{", "").replace("}", "").replace("'", ""), f"{case['growth']:.4f}"]
                + [_cell(case["predicted_rms"]), _cell(case["flown_rms"]), f"{case['lost']} of {case['flights']}"]
                + ["yes" if case["agrees"] else "no"]
            )
        header = ["link", "growth a tick", "predicted rms [m]", "flown rms [m]", "flights lost", "as predicted"]
        lines += table(header, rows)
    return lines


def analysis_text(data: dict[str, Any]) -> str:
    """Return what studies.report.analyze found, as Markdown."""
    lines = [f"# Analysis of {data['scenario']}", ""]
    lines += linearization_text(data["linearization"]) + riccati_text(data["riccati"]) + margins_text(data["margins"])
    lines += arrivals_text(data["arrivals"]) + commands_text(data["commands"], data.get("command_flights"))
    if "tube" in data:
        lines += tube_text(data["tube"])
    else:
        lines += ["## The tube along the path", "", f"Not predicted: {data['no_tube']}.", ""]
    if "honesty" in data:
        lines += honesty_text(data["honesty"])
    return "\n".join(lines).rstrip() + "\n"
