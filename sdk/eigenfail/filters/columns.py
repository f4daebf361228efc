"""The columns of an episode: what can be asked for, sorted by and exported, under one name each."""

from collections.abc import Callable
from enum import StrEnum

import msgspec

from eigenfail.values.assessment import ConflictClass
from eigenfail.values.episode import Outcome
from eigenfail.values.records import EpisodeRow

Value = int | float | str | bool


class Kind(StrEnum):
    """What a column holds; only numbers have an order."""

    NUMBER = "number"
    WHOLE = "whole number"
    TEXT = "text"
    FLAG = "true or false"


class Column(msgspec.Struct, frozen=True):
    """A column of the list of episodes.

    Attributes:
        name: in filters, sorts, fields and files.
        kind: what it holds.
        words: what it says, with its unit.
        choices: the only values of a text; empty if it may be any.
    """

    name: str
    kind: Kind
    words: str
    choices: tuple[str, ...] = ()

    @property
    def is_ordered(self) -> bool:
        """Whether it can be sorted by."""
        return self.kind in {Kind.NUMBER, Kind.WHOLE}


N, W, T = Kind.NUMBER, Kind.WHOLE, Kind.TEXT

LISTED = (
    Column("campaign", W, "id of its campaign"),
    Column("index", W, "its number within the campaign, from 0"),
    Column("seed", W, "of everything random in it"),
    Column("outcome", T, "how it ended", tuple(Outcome)),
    Column("class", T, "conflict class", tuple(ConflictClass)),
    Column("steps", W, "steps until it ended"),
    Column("source", T, "where its disturbances come from: prior, trajectory or policy"),
    Column("worker", T, "who ran it"),
    Column("robustness_m", N, "smallest distance to another vehicle [m]"),
    Column("log_probability", N, "sum of log p(a_t)"),
    Column("log_probability_per_step", N, "the same by its steps"),
    Column("severity", N, "squared relative speed at the collision [m²/s²]"),
    Column("min_ttc_s", N, "smallest time to collision [s]"),
    Column("max_drac_mps2", N, "largest deceleration required to avoid the crash [m/s²]"),
    Column("ttc_violated_s", N, "when the time to collision first fell below 1.5 s [s]"),
    Column("drac_violated_s", N, "when DRAC first exceeded 7 m/s² [s]"),
    Column("drac_at_warning_mps2", N, "DRAC at ttc_violated_s [m/s²]"),
    Column("ttc_lead_s", N, "from ttc_violated_s to the collision [s]"),
    Column("drac_lead_s", N, "from drac_violated_s to the collision [s]"),
    Column("collided_s", N, "when the collision was seen [s]"),
    Column("left_road_s", N, "when the ego was first off its road [s]"),
    Column("max_jerk_mps3", N, "largest jerk [m/s³]"),
    Column("hard_brakings", W, "how often hard braking began"),
    Column("clipped_steps", W, "steps in which more was asked for than the truck can do"),
    Column("final_drac_mps2", N, "DRAC at the last step, 0 without a conflict then [m/s²]"),
    Column("wall_s", N, "time that the worker spent on it [s]"),
    Column("finished_ms", W, "when its result was stored [ms since 1970]"),
    Column("digest", T, "SHA-256 of what happened"),
    Column("has_scene", Kind.FLAG, "whether its scene was kept"),
    Column("problem", T, "why it could not be run"),
)

COLUMNS = {column.name: column for column in LISTED}

READERS: dict[str, Callable[[EpisodeRow], Value | None]] = {
    "class": lambda row: row.assessed.conflict,
    "ttc_lead_s": lambda row: row.assessed.ttc_lead_s,
    "drac_lead_s": lambda row: row.assessed.drac_lead_s,
    "log_probability_per_step": lambda row: row.log_probability / max(row.steps, 1),
    "problem": lambda row: row.problem or None,
}
"""How to read those that are no fields of a row themselves."""


def value_of(row: EpisodeRow, column: str) -> Value | None:
    """What a row has in a column; None where nothing was measured."""
    if column in READERS:
        return READERS[column](row)
    value: Value | None = getattr(row, column)
    return value
