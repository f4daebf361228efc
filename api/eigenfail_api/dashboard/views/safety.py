"""The safety measures of a campaign: the paper's table, severity, and likelihood against it."""

import msgspec

from eigenfail.values import Figure as Number
from eigenfail.values import Rate, Safety, Violations
from eigenfail.values.assessment import IN_WORDS
from eigenfail.values.safety import FailurePoint, Scatter
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import MOST_ROWS, Chart, rounded
from eigenfail_api.dashboard.views.findings import Grid, Rows
from eigenfail_api.dashboard.views.measured import unit
from eigenfail_api.dashboard.views.summaries import Figure

COLUMNS = (
    "Measure",
    "Episodes",
    "Share, 95 % interval",
    "Median",
    "Worst",
    "n of median and worst",
)

NOT_CLASSIFIED = "not classified"
COLLISION = "collision, "


class SafetyView(msgspec.Struct, frozen=True, kw_only=True):
    """The part of a campaign's page about safety.

    Attributes:
        severity: mean, VaR and CVaR of the failures.
        remarks: why one of these, or an interval, is missing, and what the numbers cannot know.
    """

    table: Grid
    severity: tuple[tuple[str, Figure], ...]
    remarks: tuple[str, ...]


def safety_view(found: Safety) -> SafetyView:
    """Table, severity, and remarks on both."""
    remarks = (found.severity.problem, *found.notes)
    return SafetyView(
        table=Grid("Safety measures", COLUMNS, measure_lines(found)),
        severity=severity(found) if found.severity.n else (),
        remarks=tuple(filter(None, remarks)),
    )


def measure_lines(found: Safety) -> Rows:
    """Collisions, near misses, and the two measures."""
    ttc, drac = found.ttc, found.drac
    return (
        counted("Collision", found.collisions),
        counted("Near miss", found.near_misses),
        measured(f"MinTTC below {ttc.threshold:g} s", ttc, "s"),
        measured(f"DRAC above {drac.threshold:g} m/s²", drac, "m/s²"),
    )


def counted(name: str, rate: Rate | None) -> tuple[str, ...]:
    """An outcome, which has neither median nor worst case."""
    return (name, *shared(rate), formats.NONE, formats.NONE, formats.NONE)


def measured(name: str, row: Violations, name_of_unit: str) -> tuple[str, ...]:
    """A measure, and its extremes over the episodes that have it."""
    return (
        name,
        *shared(row.beyond),
        unit(row.median, name_of_unit),
        unit(row.worst, name_of_unit),
        formats.integer(row.n),
    )


def shared(rate: Rate | None) -> tuple[str, str]:
    """How many episodes, and their share with its interval."""
    if rate is None:
        return formats.NONE, formats.NONE
    if not rate.k:
        return "0", f"≤ {formats.percent(rate.interval.high)}"
    interval = formats.rate_interval(rate)
    return formats.integer(rate.k), f"{formats.percent(rate.value)} ({interval})"


def severity(found: Safety) -> tuple[tuple[str, Figure], ...]:
    """How severe the failures are: on average, and at their worst."""
    risk = found.severity
    basis = f"n = {formats.integer(risk.n)}"
    beyond = f"{formats.number(risk.beyond)} failures beyond"
    level = f"{100.0 * risk.level:g} %"
    return (
        ("Mean severity [m²/s²]", figure(risk.mean, basis)),
        (f"VaR {level} [m²/s²]", figure(risk.var, beyond)),
        (f"CVaR {level} [m²/s²]", figure(risk.cvar, beyond)),
        ("Severity against log p, ρ", rank_correlation(found.scatter)),
    )


def rank_correlation(scatter: Scatter) -> Figure:
    """Whether the severe failures are the rarer ones."""
    return figure(scatter.rank_correlation, f"Spearman, n = {len(scatter.points)}")


def figure(found: Number | None, basis: str) -> Figure:
    """A number with its interval and its basis."""
    if found is None:
        return Figure(formats.NONE, ("too few failures", basis))
    interval = (formats.interval(found.interval),) if found.interval else ("no interval",)
    return Figure(formats.number(found.value), (*interval, basis))


def scatter_chart(scatter: Scatter) -> Chart:
    """How likely the failures are, and how bad."""
    points = scatter.points
    return Chart(
        id="likelihood-chart",
        kind="likelihood",
        title="Likelihood and severity of failures",
        caption=(
            "Each failure: log-probability of its noise per step, and severity [m²/s²]. Up and to "
            f"the right are the likely and severe ones. {coverage(scatter)}"
        ),
        data={
            "index": [point.index for point in points],
            "likelihood": rounded(point.log_probability_per_step for point in points),
            "severity": rounded(point.severity for point in points),
            "kind": [kind(point) for point in points],
        },
        columns=("Episode", "log p per step", "Severity [m²/s²]", "Class"),
        rows=tuple(map(point_row, points[:MOST_ROWS])),
        note=f"The first {MOST_ROWS}." if len(points) > MOST_ROWS else "",
    )


def point_row(point: FailurePoint) -> tuple[str, ...]:
    """One failure."""
    figures = (point.log_probability_per_step, point.severity)
    return (str(point.index), *map(formats.number, figures), kind(point))


def kind(point: FailurePoint) -> str:
    """Whose failure it is."""
    words = IN_WORDS[point.conflict] if point.conflict else NOT_CLASSIFIED
    return words.removeprefix(COLLISION)


def coverage(scatter: Scatter) -> str:
    """Whether all of them are drawn."""
    if len(scatter.points) >= scatter.of:
        return ""
    return f"{formats.integer(len(scatter.points))} of {formats.integer(scatter.of)}."
