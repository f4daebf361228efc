"""An explained episode as it is printed: a line on the replay, a table, and the story."""

from collections.abc import Callable, Sequence

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN, number
from eigenfail.cli.tables import table
from eigenfail.values import ExplainedStep, Explanation

Cell = Callable[[ExplainedStep], str]


def drawn(explanation: Explanation) -> Group:
    """For people."""
    before = [line for line in (explanation.verdict, explanation.note) if line]
    return Group(
        *(Text(line) for line in before),
        "",
        step_table(explanation.steps),
        Text(UNITS),
        "",
        *(Text(line) for line in explanation.story),
    )


def said(name: str, digits: int = 1) -> Cell:
    """A cell with what the account holds under a name."""

    def cell(step: ExplainedStep) -> str:
        value = step.account.get(name)
        return (value or UNKNOWN) if isinstance(value, str) else number(value, digits)

    return cell


CELLS: dict[str, Cell] = {
    "time": lambda step: number(step.time_s, 1),
    "mode": said("mode"),
    "candidate": said("candidate"),
    "rule": said("rule"),
    "override": said("override"),
    "QP": said("qp_status"),
    "heeds": said("heeds"),
    "gap": said("gap_m"),
    "true gap": lambda step: number(step.gap_m, 1),
    "closing": said("closing_mps"),
    "truly closing": lambda step: number(step.closing_mps, 1),
    "tracks": said("tracks"),
    "lost": said("lost_tracks", 0),
    "noise": lambda step: "{:+.1f} {:+.1f}".format(*step.disturbance),
    "acceleration": lambda step: number(step.acceleration_mps2, 2),
    "steering": lambda step: number(step.steering_rad, 3),
}
UNITS = (
    "Times in s, gaps in m, closing speeds in m/s, noise (longitudinal, lateral) in sigma,"
    " acceleration in m/s², steering in rad; gap and closing are what the planner believes."
)

SHOWN_ABOVE = frozenset(
    (
        *("mode", "candidate", "rule", "override", "qp_status"),
        *("heeds", "gap_m", "closing_mps", "tracks", "lost_tracks"),
    )
)
WORDS = frozenset(("mode", "candidate", "rule", "override", "QP", "heeds", "tracks"))


def step_table(steps: Sequence[ExplainedStep]) -> Table:
    """One row a step; what no step knows has no column, and what else a planner says has one."""
    more = dict.fromkeys(name for step in steps for name in step.account if name not in SHOWN_ABOVE)
    cells = CELLS | {name: said(name, 2) for name in more}
    columns = {heading: [cell(step) for step in steps] for heading, cell in cells.items()}
    known = {name: column for name, column in columns.items() if {*column} - {UNKNOWN}}
    grid = table(*known, right=known.keys() - WORDS)
    for row in zip(*known.values(), strict=True):
        grid.add_row(*(escape(text) for text in row))
    return grid
