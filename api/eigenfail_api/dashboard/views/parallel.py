"""Episodes as lines over parallel axes."""

from collections.abc import Sequence

from eigenfail.filters import value_of
from eigenfail.values import Outcome
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import MOST_ROWS, Chart, rounded

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
            f"{coverage(len(rows), is_all=is_all)} One line each. Draw along an axis to narrow the "
            "list below: it becomes a condition of the filter."
        ),
        data={
            "columns": list(AXES),
            "names": list(AXES.values()),
            "values": [rounded(values[name]) for name in AXES],
            "collision": [row.outcome is Outcome.COLLISION for row in rows],
        },
        columns=("Episode", "Outcome", *AXES.values()),
        rows=tuple(
            (
                str(row.index),
                row.outcome,
                *(formats.number(value) for value in (number(row, name) for name in AXES)),
            )
            for row in rows[:MOST_ROWS]
        ),
        note=f"The first {MOST_ROWS}." if len(rows) > MOST_ROWS else "",
    )


def number(row: EpisodeRow, column: str) -> float | None:
    """What a row has on an axis."""
    value = value_of(row, column)
    return None if value is None else float(value)


def coverage(count: int, *, is_all: bool) -> str:
    """Whether all episodes of the filter are drawn."""
    if is_all:
        return ONE if count == 1 else f"All {formats.integer(count)} episodes that match."
    return f"A sample of {formats.integer(count)} of the episodes that match."
