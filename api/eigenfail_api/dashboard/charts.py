"""Charts: the data that the browser draws, and the table behind each."""

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from eigenfail.filters import read_value
from eigenfail.presentation.figures import (
    count_noun,
    format_count,
    format_number,
    format_percent_interval,
    format_share,
)
from eigenfail.values import Course, CourseBlock, Outcome
from eigenfail.values.records import EpisodeRow
from eigenfail.values.sample import EpisodeSample

DIGITS = 5
MOST_ROWS = 200


class Chart(msgspec.Struct, frozen=True):
    """What a browser draws, and what is read where nothing is drawn.

    Attributes:
        id: of its element on the page.
        kind: which module draws it.
        title: what it shows.
        caption: how to read it, in a sentence.
        data: for the module, plain JSON.
        columns: of the table.
        rows: of the table, as text.
        note: what the table leaves out.
    """

    id: str
    kind: str
    title: str
    caption: str
    data: dict[str, object]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def round_values(values: Iterable[float | None]) -> list[float | None]:
    """Floats with as many digits as a screen can show."""
    return [None if value is None else float(f"{value:.{DIGITS}g}") for value in values]


def rounded_rows(array: np.ndarray) -> list[list[float | None]]:
    """The rows of a matrix, likewise."""
    return [round_values(float(value) for value in row) for row in array]


def curve_chart(course: Course) -> Chart:
    """Failure rate over the course of the campaign."""
    blocks = course.blocks
    return Chart(
        id="curve-chart",
        kind="curve",
        title=course.heading,
        caption=(
            f"Failure rate by blocks of {count_noun(course.per, 'episode')}, with 95 % "
            "intervals; the table holds likelihood and robustness, too."
        ),
        data={
            "middle": [(block.first + block.last) / 2.0 for block in blocks],
            "span": [span(block) for block in blocks],
            "rate": round_values(100.0 * block.failure_rate.value for block in blocks),
            "low": round_values(100.0 * block.failure_rate.interval.low for block in blocks),
            "high": round_values(100.0 * block.failure_rate.interval.high for block in blocks),
        },
        columns=(
            *("Episodes", "Failures", "Completed", "Rate", "95 % interval"),
            *("log p per step of the failures", "Median robustness [m]"),
        ),
        rows=tuple(
            (
                span(block),
                format_count(block.failure_rate.k),
                format_count(block.failure_rate.n),
                format_share(block.failure_rate.value),
                format_percent_interval(block.failure_rate.interval),
                format_number(block.log_probability_per_step),
                format_number(block.median_robustness_m),
            )
            for block in blocks
        ),
    )


def span(block: CourseBlock) -> str:
    """From which episode to which."""
    return f"{block.first} – {block.last}"


def robustness_chart(
    rows: Sequence[EpisodeRow | EpisodeSample], course: Course, ended: int
) -> Chart:
    """How near the ego came to another vehicle in each episode."""
    measured = [row for row in rows if row.robustness_m is not None]
    return Chart(
        id="robustness-chart",
        kind="robustness",
        title="Robustness",
        caption=(
            "Smallest distance between footprints in each episode [m], or a function's answer; "
            "0 is a failure. "
            f"{coverage(rows, ended)}"
        ),
        data={
            "index": [row.index for row in measured],
            "robustness": round_values(row.robustness_m for row in measured),
            "collision": [row.outcome is Outcome.COLLISION for row in measured],
        },
        columns=("Episodes", "Completed", "Smallest [m]", "Median [m]"),
        rows=tuple(
            (
                span(block),
                format_count(block.failure_rate.n),
                format_number(block.smallest_robustness_m),
                format_number(block.median_robustness_m),
            )
            for block in course.blocks
        ),
        note="By blocks of episodes; each episode by itself is in the API.",
    )


def coverage(rows: Sequence[object], of: int) -> str:
    """Whether all of them are drawn."""
    if len(rows) >= of:
        return ""
    return f"A sample of {format_count(len(rows))} of {format_count(of)}."


AXES = {
    "robustness_m": "Robustness [m]",
    "log_probability_per_step": "log p per step",
    "severity": "Severity [m²/s²]",
    "min_ttc_s": "MinTTC [s]",
    "max_drac_mps2": "DRAC [m/s²]",
    "steps": "Steps",
}
ONE = "The only episode that matches."


def parallel_chart(rows: Sequence[EpisodeRow], *, is_all: bool) -> Chart:
    """One line for each episode."""
    values = {name: [number(row, name) for row in rows] for name in AXES}
    return Chart(
        id="parallel-chart",
        kind="parallel",
        title="All measures at once",
        caption=(
            f"{describe_coverage(len(rows), is_all=is_all)} One line each. Draw along an axis to "
            "narrow the list below: it becomes a condition of the filter."
        ),
        data={
            "columns": list(AXES),
            "names": list(AXES.values()),
            "values": [round_values(values[name]) for name in AXES],
            "collision": [row.outcome is Outcome.COLLISION for row in rows],
        },
        columns=("Episode", "Outcome", *AXES.values()),
        rows=tuple(
            (
                str(row.index),
                row.outcome.word,
                *(format_number(value) for value in (number(row, name) for name in AXES)),
            )
            for row in rows[:MOST_ROWS]
        ),
        note=f"The first {MOST_ROWS}." if len(rows) > MOST_ROWS else "",
    )


def number(row: EpisodeRow, column: str) -> float | None:
    """What a row has on an axis."""
    value = read_value(row, column)
    return None if value is None else float(value)


def describe_coverage(count: int, *, is_all: bool) -> str:
    """Whether all episodes of the filter are drawn."""
    if is_all:
        return ONE if count == 1 else f"All {format_count(count)} episodes that match."
    return f"A sample of {format_count(count)} of the episodes that match."
