"""The paper's tables and statements as values, and the numbers that the paper prints."""

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from eigenfail.values.estimates import Interval

REPLAYED = "share of replays"
"""Unit of shares of a few replays of chosen noise: no random sample, so without an interval."""


class DrawCounts(msgspec.Struct, frozen=True):
    """Counts of independent draws.

    Attributes:
        k: number of draws that are known to be events.
        trials: number of all draws.
        doubtful: number of further draws that may be events: they errored, or were cut short.
    """

    k: int
    trials: int
    doubtful: int


class PaperNumber(msgspec.Struct, frozen=True):
    """One of our numbers, with the paper's.

    Attributes:
        value: None if undefined, such as the severity of no failures.
        n: number of episodes or failures behind it.
        paper: the paper's number; None if the paper gives none.
        draws: counts behind the share of independent draws; None for other numbers.
    """

    value: float | None
    n: int
    interval: Interval | None = None
    paper: float | None = None
    draws: DrawCounts | None = None


class PaperRow(msgspec.Struct, frozen=True):
    """A row of a table; numbers in the order of the table's columns."""

    name: str
    numbers: tuple[PaperNumber, ...]
    campaign: int | None = None


class PaperColumn(msgspec.Struct, frozen=True):
    """Name, title and unit of a column.

    The unit "share" is printed in percent, `REPLAYED` as k of n.
    """

    name: str
    title: str
    unit: str


class PaperTable(msgspec.Struct, frozen=True):
    """One table of the paper, with our numbers and the printed ones.

    Attributes:
        name: short name, for files and claims.
        note: what a reader must know to compare.
    """

    name: str
    title: str
    columns: tuple[PaperColumn, ...]
    rows: tuple[PaperRow, ...]
    note: str = ""


class PaperStatement(msgspec.Struct, frozen=True):
    """A statement of the paper, judged by our numbers.

    Attributes:
        holds: None if our numbers cannot decide.
        rule: what must be so for the statement to hold, and for it not to hold.
        figures: the numbers that decide it.
        why: what explains it where it does not hold; shown only there.
        subject: what of several campaigns it was judged by, such as "ast"; empty if there is
            one choice.
        asked: whether our runs have what the statement is about, such as failures to compare.
    """

    paper: str
    holds: bool | None
    figures: str
    why: str = ""
    rule: str = ""
    subject: str = ""
    asked: bool = True


class PaperReproduction(msgspec.Struct, frozen=True):
    """All tables and statements, at one scale and seed."""

    scale: str
    seed: int
    tables: tuple[PaperTable, ...]
    statements: tuple[PaperStatement, ...]
    scenario: str = "cut_in"


Numbers = Mapping[str, float]
Rows = Mapping[str, Numbers]


def _publish(rate: float, log_p: float, severity: float) -> Numbers:
    """Return failure rate [%] as a share, mean log p of the failures, mean severity [m²/s²]."""
    return {"failure_rate": rate / 100.0, "log_p": log_p, "severity": severity}


PLANNERS: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0, "severity": 0.0},
        "monte_carlo idm": {"failure_rate": 0.401, "severity": 0.719},
    }
)

SWEEP: Rows = MappingProxyType(
    {
        "sweep base": _publish(96, -5360.22, 152.47),
        "sweep alpha=500": _publish(45, -2465.45, 137.28),
        "sweep alpha=1000": _publish(72, -2124.35, 126.37),
        "sweep alpha=5000": _publish(55, -3950.79, 150.77),
        "sweep c_dist=100": _publish(93, -7340.49, 145.40),
        "sweep c_dist=5000": _publish(98, -7512.87, 165.92),
        "sweep learning_rate=0.001": _publish(3, -1185.76, 122.90),
        "sweep learning_rate=0.0001": _publish(96, -5694.37, 188.23),
        "sweep learning_rate=5e-05": _publish(3, -1885.44, 119.94),
        "sweep batch_size=16": _publish(100, -4014.96, 175.52),
        "sweep batch_size=256": _publish(96, -7250.31, 165.64),
        "sweep tau=0.001": _publish(99, -3218.86, 136.15),
        "sweep tau=0.01": _publish(98, -4002.00, 155.10),
        "sweep buffer_size=10000": _publish(98, -3861.41, 131.12),
    }
)
TRAINING: Rows = MappingProxyType(
    {
        "ast_paper": {**_publish(87.7, -4506.13, 152.63), "cost_usd": 0.012},
        "difs_paper": {**_publish(2.4, -1495.67, 124.93), "cost_usd": 0.648},
    }
)

EVALUATION: Rows = MappingProxyType(
    {
        "monte_carlo rulebook": {"failure_rate": 0.0},
        "held": {},
        "ast_paper evaluation": {**_publish(94.6, -2870.26, 164.75), "cost_usd": 0.023},
        "difs_paper evaluation": {**_publish(3.1, -1490.71, 115.21), "cost_usd": 0.518},
    }
)

GENERALISATION: tuple[Numbers, ...] = (
    {"failure_rate": 0.946, "severity": 164.75},
    {"failure_rate": 1.0, "severity": 190.50},
    {"failure_rate": 1.0, "severity": 174.45},
)
"""Where AST was trained, where the car cuts in 5 m further, and where it does 5 m nearer."""

SAFETY: Rows = MappingProxyType(
    {
        "collision": {"count": 9},
        "min_ttc": {"count": 19, "median": 3.50, "worst": 0.015},
        "drac": {"count": 4, "median": 0.40, "worst": 43.633},
    }
)
SAFETY_EPISODES = 300
"""Of DiFS."""
SAFETY_COUNTS = ", ".join(f"{row['count']:g}" for row in SAFETY.values())

EXPLAINED_BY_THREE = MappingProxyType({"longitudinal": 0.40})

MODES = 3
