"""Many episodes: how the failure rate moves, how near they came, how bad the failures are."""

from collections.abc import Sequence
from itertools import pairwise

import msgspec

from eigenfail.values import Outcome, Rate
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import MOST_ROWS, Chart, rounded
from eigenfail_services.statistics.intervals import rate

BLOCKS = 20
LEAST_PER_BLOCK = 10


class Block(msgspec.Struct, frozen=True):
    """Neighbouring episodes.

    Attributes:
        first: smallest index.
        last: largest index.
        rate: of failures among those that were completed.
        nearest_m: smallest robustness.
        median_m: median robustness.
    """

    first: int
    last: int
    rate: Rate
    nearest_m: float
    median_m: float


def blocks_of(rows: Sequence[EpisodeRow]) -> list[Block]:
    """At most `BLOCKS` blocks of equally many completed episodes, in index order."""
    done = [row for row in rows if row.outcome is not Outcome.FAILED]
    count = max(1, min(BLOCKS, len(done) // LEAST_PER_BLOCK))
    edges = [block * len(done) // count for block in range(count + 1)]
    return [block_of(done[start:end]) for start, end in pairwise(edges) if end > start]


def block_of(rows: Sequence[EpisodeRow]) -> Block:
    """One block, of at least one episode."""
    distances = sorted(row.robustness_m or 0.0 for row in rows)
    failures = sum(row.outcome is Outcome.COLLISION for row in rows)
    return Block(
        first=rows[0].index,
        last=rows[-1].index,
        rate=rate(failures, len(rows)),
        nearest_m=distances[0],
        median_m=distances[len(distances) // 2],
    )


def curve_chart(rows: Sequence[EpisodeRow], ended: int) -> Chart:
    """Failure rate over the course of the campaign."""
    blocks = blocks_of(rows)
    return Chart(
        id="curve-chart",
        kind="curve",
        title="Learning curve",
        caption=f"Failure rate by blocks of episodes, with 95 % intervals. {coverage(rows, ended)}",
        data={
            "middle": [(block.first + block.last) / 2.0 for block in blocks],
            "span": [f"{block.first} – {block.last}" for block in blocks],
            "rate": rounded(100.0 * block.rate.value for block in blocks),
            "low": rounded(100.0 * block.rate.interval.low for block in blocks),
            "high": rounded(100.0 * block.rate.interval.high for block in blocks),
        },
        columns=("Episodes", "Failures", "Completed", "Rate", "95 % interval"),
        rows=tuple(
            (
                f"{block.first} – {block.last}",
                formats.integer(block.rate.k),
                formats.integer(block.rate.n),
                formats.percent(block.rate.value),
                formats.rate_interval(block.rate),
            )
            for block in blocks
        ),
    )


def robustness_chart(rows: Sequence[EpisodeRow], ended: int) -> Chart:
    """How near the ego came to another vehicle in each episode."""
    measured = [row for row in rows if row.robustness_m is not None]
    return Chart(
        id="robustness-chart",
        kind="robustness",
        title="Robustness",
        caption=(
            "Smallest distance between footprints in each episode [m]; 0 is a collision. "
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
                f"{block.first} – {block.last}",
                formats.integer(block.rate.n),
                formats.number(block.nearest_m),
                formats.number(block.median_m),
            )
            for block in blocks_of(rows)
        ),
        note="By blocks of episodes; each episode by itself is in the API.",
    )


def likelihood_chart(failures: Sequence[EpisodeRow], count: int) -> Chart:
    """How likely the failures are, and how bad."""
    likelihood = [row.log_probability / max(row.steps, 1) for row in failures]
    return Chart(
        id="likelihood-chart",
        kind="likelihood",
        title="Likelihood and severity of failures",
        caption=(
            "Each failure: log-probability of its noise per step, and severity [m²/s²]. Up and to "
            f"the right are the likely and severe ones. {coverage(failures, count)}"
        ),
        data={
            "index": [row.index for row in failures],
            "likelihood": rounded(likelihood),
            "severity": rounded(row.severity for row in failures),
        },
        columns=("Episode", "log p per step", "Severity [m²/s²]"),
        rows=tuple(
            (str(row.index), formats.number(value), formats.number(row.severity))
            for row, value in zip(failures[:MOST_ROWS], likelihood, strict=False)
        ),
        note=f"The first {MOST_ROWS}." if len(failures) > MOST_ROWS else "",
    )


def coverage(rows: Sequence[EpisodeRow], of: int) -> str:
    """Whether all of them are drawn."""
    if len(rows) >= of:
        return ""
    return f"A sample of {formats.integer(len(rows))} of {formats.integer(of)}."
