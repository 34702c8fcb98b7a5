"""The command `ortilo doctor`: what is installed, what is missing, and how to mend it."""

import typer
from rich.markup import escape

from ortilo_drake.commands.options import JsonOption
from ortilo_drake.commands.terminal import out, write_json


def doctor(json_file: JsonOption = None) -> None:
    """Check this machine for all that flights need or can use; exit code 1 if something needed is missing."""
    from ortilo_drake.commands.doctor_checks import CHECKS, NEEDED, Finding

    findings: list[Finding] = []
    for check in CHECKS:
        finding = check()
        findings.append(finding)
        mark = (
            "[green]OK[/]     "
            if finding.is_there
            else "[red]missing[/]"
            if finding.weight == NEEDED
            else "[yellow]without[/]"
        )
        out.print(f"{mark} {finding.name:24}{escape(finding.found)}", soft_wrap=True)
        if not finding.is_there and finding.mend:
            out.print(f"        {escape(finding.mend)}", soft_wrap=True)
    write_json(json_file, [finding._asdict() for finding in findings])
    missing = [finding.name for finding in findings if not finding.is_there and finding.weight == NEEDED]
    out.print(f"missing: {', '.join(missing)}" if missing else "all that flights need is there")
    if missing:
        raise typer.Exit(1)
