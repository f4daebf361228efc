"""Many episodes: how the failure rate moves, how near they came, how bad the failures are."""

from collections.abc import Sequence

from eigenfail.values import Course, CourseBlock, Outcome
from eigenfail.values.records import EpisodeRow
from eigenfail.values.sample import EpisodeSample
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded


def curve_chart(course: Course) -> Chart:
    """Failure rate over the course of the campaign."""
    blocks = course.blocks
    return Chart(
        id="curve-chart",
        kind="curve",
        title=course.heading,
        caption=(
            f"Failure rate by blocks of {formats.counted(course.per, 'episode')}, with 95 % "
            "intervals; the table holds likelihood and robustness, too."
        ),
        data={
            "middle": [(block.first + block.last) / 2.0 for block in blocks],
            "span": [span(block) for block in blocks],
            "rate": rounded(100.0 * block.failure_rate.value for block in blocks),
            "low": rounded(100.0 * block.failure_rate.interval.low for block in blocks),
            "high": rounded(100.0 * block.failure_rate.interval.high for block in blocks),
        },
        columns=(
            *("Episodes", "Failures", "Completed", "Rate", "95 % interval"),
            *("log p per step of the failures", "Median robustness [m]"),
        ),
        rows=tuple(
            (
                span(block),
                formats.integer(block.failure_rate.k),
                formats.integer(block.failure_rate.n),
                formats.percent(block.failure_rate.value),
                formats.rate_interval(block.failure_rate),
                formats.number(block.log_probability_per_step),
                formats.number(block.median_robustness_m),
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
            "robustness": rounded(row.robustness_m for row in measured),
            "collision": [row.outcome is Outcome.COLLISION for row in measured],
        },
        columns=("Episodes", "Completed", "Smallest [m]", "Median [m]"),
        rows=tuple(
            (
                span(block),
                formats.integer(block.failure_rate.n),
                formats.number(block.smallest_robustness_m),
                formats.number(block.median_robustness_m),
            )
            for block in course.blocks
        ),
        note="By blocks of episodes; each episode by itself is in the API.",
    )


def coverage(rows: Sequence[object], of: int) -> str:
    """Whether all of them are drawn."""
    if len(rows) >= of:
        return ""
    return f"A sample of {formats.integer(len(rows))} of {formats.integer(of)}."
