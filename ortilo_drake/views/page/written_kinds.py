"""The kinds of files that commands write, known by the keys of a JSON file or the heading of a Markdown report."""

import fnmatch
import glob
import re
import shlex
from pathlib import Path
from typing import Any, Final, NamedTuple


class Kind(NamedTuple):
    """A kind of file that a command writes."""

    command: str
    """the command, up to its scenario or preset."""
    keys: frozenset[str]
    """of its JSON file, or of each row where that is a list, by which it is known."""
    subject: str | None = None
    """the key of its scenario or preset in there, dotted; None if it is not in there."""
    heading: str | None = None
    """of its .md file, a pattern whose group is the scenario or preset; None if it writes none."""
    figures: str = ""
    """the stem of its figures in its folder, PNG or SVG, as a pattern; {} stands for the scenario or preset."""
    takes_subject: bool = True
    """whether the scenario or preset is the command's argument; a sweep's file, say, is not named."""

    @property
    def name(self) -> str:
        """The command without the option that its subject belongs to."""
        return self.command.split(" --")[0]


SHOWN: Final = {".png": "image/png", ".svg": "image/svg+xml"}  # pictures that a page can hold; a PDF it cannot
_RARE = (
    r"# (.+?)(?:: (?:about|fewer than) one flight in "
    r"| (?:loses its vehicle|strays \S+ m or more from its (?:reference|path))"
    r"(?:: fewer | in (?:about|fewer than) \d+% of flights))"
)
KINDS: Final = (
    Kind("ortilo fly", frozenset({"scenario", "seed", "mse", "arrivals"}), "scenario"),
    Kind(
        "ortilo tables --preset",
        frozenset({"preset", "flights", "estimation", "path", "paper"}),
        "preset",
        r"# The paper's tables, preset '(\w+)'",
        "*_{}",
    ),
    Kind(
        "ortilo analyze",
        frozenset({"scenario", "flights", "no_theory", "no_tube"}),
        "scenario",
        r"# Analysis of (\S+)",
        "*",
    ),
    Kind(
        "ortilo sensitivity",
        frozenset({"scenario", "rows", "limits"}),
        "scenario",
        r"# What must you know, how well: (\S+)",
        "{}",
    ),
    Kind(
        "ortilo faults", frozenset({"scenarios", "flights", "start", "rows"}), None, r"# Faults in flight()", "faults"
    ),
    Kind("ortilo rare", frozenset({"scenario", "verdict", "probability", "independent"}), "scenario", _RARE),
    Kind(
        "ortilo map", frozenset({"sweep", "rows", "by_drake"}), "sweep.scenario", r"# A map of (.+) over ", "map", False
    ),
    Kind("ortilo replay --map", frozenset({"map", "motions"}), None, r"# Recorded motions()", "*"),
    Kind("ortilo fit", frozenset({"uwb", "imu", "intervals", "recordings"})),
    Kind("ortilo predict", frozenset({"noise", "flights", "group"}), None, r"# Predicted flights()", "predicted"),
    Kind("ortilo replay", frozenset({"ticks", "identical", "first_difference"})),
    Kind("ortilo hindsight", frozenset({"scenario", "estimator", "rows", "flights"}), "scenario"),
    Kind(
        "ortilo tune --fly", frozenset({"search", "best", "history", "judged"}), "search.scenario", takes_subject=False
    ),
    Kind("ortilo tune --map", frozenset({"settings", "settings_before", "computed", "motions"})),
    Kind(
        "ortilo tune", frozenset({"scenario", "numbers", "log_likelihood", "counted"}), "scenario", takes_subject=False
    ),
    Kind("ortilo room coverage", frozenset({"scenario", "room", "answer", "over_floor"}), "room", takes_subject=False),
    Kind(
        "ortilo room place", frozenset({"scenario", "candidates", "gain", "landmarks"}), "scenario", takes_subject=False
    ),
    Kind("ortilo room survey", frozenset({"room", "known", "anchors", "covariance"}), "room", takes_subject=False),
    Kind("ortilo detector evaluate", frozenset({"map50", "sets", "ms_per_frame"})),
    Kind("ortilo detector recognise", frozenset({"number", "label", "way", "near"})),
    Kind("ortilo doctor", frozenset({"name", "is_there", "weight", "mend"})),
    Kind("ortilo hil check", frozenset({"identical", "latency_ms", "missed_deadlines", "lost"})),
    Kind("ortilo hil bridge --from", frozenset({"messages", "taken", "estimates", "not_begun"})),
    Kind("ortilo hil bridge", frozenset({"ticks", "without_world", "without_answer"})),
    Kind("ortilo hil world", frozenset({"ticks", "packets", "rejected", "lost"})),
    Kind("ortilo hil onboard", frozenset({"ticks", "packets", "rejected"})),
    Kind("ortilo hil onboard --profile", frozenset({"block", "median_us", "p99_us", "share"})),
    Kind("ortilo hil relay", frozenset({"to_onboard", "to_world"})),
)
_GROUPS = dict.fromkeys(kind.name.split()[1] for kind in KINDS)
ALLOWED: Final = f"must be a flight's .nc, or the --out folder or --json file of {', '.join(_GROUPS)}"


def kind_of(data: Any) -> Kind | None:
    """Return the kind of a JSON file's data by the command that wrote it; None if none did."""
    if isinstance(data, list):
        data = data[0] if data and all(isinstance(row, dict) and row.keys() == data[0].keys() for row in data) else None
    return next((kind for kind in KINDS if isinstance(data, dict) and kind.keys <= data.keys()), None)


def command_of(kind: Kind, subject: str) -> str:
    """Return the command as it is typed, as far as it is known."""
    return f"{kind.command} {shlex.quote(subject)}" if subject and kind.takes_subject else kind.command


def figures_of(kind: Kind, subject: str, folder: Path) -> list[Path]:
    """Return the figures of a report in its folder; none of another folder, whatever the subject is called."""
    pattern = kind.figures.format(glob.escape(subject))
    return [
        file for file in sorted(folder.iterdir()) if file.suffix in SHOWN and fnmatch.fnmatchcase(file.stem, pattern)
    ]


def subject_of(kind: Kind, data: Any) -> str:
    """Return the scenario or preset of a JSON file's data; empty if it is not in there."""
    for key in kind.subject.split(".") if kind.subject else ():
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, str) else ""


def kinds_of_report(text: str) -> list[tuple[Kind, str]]:
    """Return the kind of a Markdown report, by its command, and its scenario or preset; empty if none wrote it."""
    found = [(kind, re.match(kind.heading, text)) for kind in KINDS if kind.heading]
    return [(kind, match[1]) for kind, match in found if match]
