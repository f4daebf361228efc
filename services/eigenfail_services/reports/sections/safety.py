"""Safety measures of all episodes, collisions or not (paper, table of safety measures)."""

from eigenfail.values import Figure as Number
from eigenfail.values import MeanTime, Rate, SeverityRisk, Violations
from eigenfail.values.report import Cell, ReportSection
from eigenfail.values.safety import LEVEL
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Part, side_by_side, table

COLUMNS = (
    ("campaign", "Campaign"),
    ("measure", "Measure"),
    ("k", "Count"),
    ("n", "of"),
    ("value", "Value"),
    ("low", "from"),
    ("high", "to"),
    ("unit", "Unit"),
)
HOW_TO_READ = (
    "MinTTC is an episode's smallest time to collision, DRAC the largest deceleration that would "
    "have been required to avoid the crash; thresholds are 1.5 s and 7.0 m/s². A near miss is "
    "MinTTC below 1.5 s without a collision. A collision is unavoidable where DRAC was above "
    "7.0 m/s² when TTC first fell below 1.5 s, or where nothing showed before the contact; "
    "otherwise it is a planner's failure. Lead times end at the collision."
)


def part(material: Material) -> Part:
    """The measures side by side."""
    subjects = material.subjects
    rows = [row for subject in subjects for row in measures(subject)]
    section = ReportSection(
        name="safety",
        title="Safety measures",
        words=(HOW_TO_READ, *(note for subject in subjects for note in notes(subject))),
        tables=(table("safety", "Safety measures of all completed episodes", COLUMNS, rows),),
    )
    return Part(section, {"safety": side_by_side(subjects, FIGURES)})


def notes(subject: Subject) -> tuple[str, ...]:
    """What the numbers of a campaign cannot know."""
    found = subject.safety
    problem = (found.severity.problem,) if found.severity.n else ()
    told = (*found.notes, *filter(None, problem))
    return tuple(f"Campaign {subject.id}: {note}" for note in told)


def measures(subject: Subject) -> list[tuple[Cell, ...]]:
    """A row for each measure: what is counted, or measured over n episodes."""
    found = subject.safety
    conflicts, collided = found.conflicts, subject.summary.counts.failures
    rows = (
        ("collisions", *share(found.collisions)),
        ("near misses", *share(found.near_misses)),
        ("unresolved at the horizon", *count(found.unresolved.count, found.completed)),
        ("MinTTC below threshold", *share(found.ttc.beyond)),
        ("MinTTC median", None, found.ttc.n, found.ttc.median, None, None, "s"),
        ("MinTTC worst", None, found.ttc.n, found.ttc.worst, None, None, "s"),
        ("DRAC above threshold", *share(found.drac.beyond)),
        ("DRAC median", None, found.drac.n, found.drac.median, None, None, "m/s²"),
        ("DRAC worst", None, found.drac.n, found.drac.worst, None, None, "m/s²"),
        ("collisions unavoidable", *count(conflicts.unavoidable, collided)),
        ("collisions by the planner", *count(conflicts.planner_failures, collided)),
        ("collisions not classified", *count(conflicts.unclassified, collided)),
        ("mean lead time of MinTTC", *mean(conflicts.ttc_lead)),
        ("mean lead time of DRAC", *mean(conflicts.drac_lead)),
        ("severity mean", *severity(found.severity, found.severity.mean)),
        (f"severity VaR {found.severity.level:g}", *severity(found.severity, found.severity.var)),
        (f"severity CVaR {found.severity.level:g}", *severity(found.severity, found.severity.cvar)),
    )
    return [(subject.id, *row) for row in rows]


def share(found: Rate | None) -> tuple[Cell, ...]:
    """k of n as a share with its interval."""
    if found is None:
        return (None, None, None, None, None, "share")
    return (found.k, found.n, found.value, found.interval.low, found.interval.high, "share")


def count(k: int, n: int) -> tuple[Cell, ...]:
    """k of n."""
    return (k, n, None, None, None, "")


def mean(found: MeanTime) -> tuple[Cell, ...]:
    """A mean time."""
    return (None, found.n, found.mean_s, None, None, "s")


def severity(risk: SeverityRisk, found: Number | None) -> tuple[Cell, ...]:
    """A figure of the failures' severity with its interval."""
    bounds = found.interval if found else None
    value = found.value if found else None
    ends = (bounds.low, bounds.high) if bounds else (None, None)
    return (None, risk.n, value, *ends, "m²/s²")


def of(found: Rate | None) -> formats.Lines:
    """k of n, and the share."""
    if found is None:
        return (formats.NONE, formats.NOTHING_YET)
    return (f"{found.k:,} of {found.n:,}", f"95 %: {formats.bounds(found.interval, 100.0)} %")


def beyond(found: Violations, unit: str) -> formats.Lines:
    """How often a threshold was passed, and what was measured."""
    middle, worst = formats.number(found.median), formats.number(found.worst)
    return (*of(found.beyond), f"median {middle} {unit}, worst {worst} {unit} (n = {found.n:,})")


def collisions(k: int, subject: Subject) -> formats.Lines:
    """So many of the collisions, if there are any."""
    count = subject.summary.counts.failures
    return (f"{k:,} of {count:,} collisions",) if count else (formats.NONE,)


def lead(found: MeanTime) -> formats.Lines:
    """A mean lead time, and what it rests on."""
    if found.mean_s is None:
        return (formats.NONE, "no such collision")
    return (f"{formats.number(found.mean_s)} s", f"mean of {found.n:,}")


def risk(subject: Subject, found: Number | None) -> formats.Lines:
    """A figure of severity with its interval."""
    n = f"n = {subject.safety.severity.n:,}"
    if found is None:
        return (formats.NONE, n)
    bounds = f"95 %: {formats.bounds(found.interval)}, " if found.interval else ""
    return (formats.number(found.value), f"{bounds}{n}")


FIGURES = {
    "Collisions": lambda s: of(s.safety.collisions),
    "Near misses": lambda s: of(s.safety.near_misses),
    "Unresolved at the horizon": lambda s: (
        f"{s.safety.unresolved.count:,} of {s.safety.completed:,}",
    ),
    "MinTTC below 1.5 s": lambda s: beyond(s.safety.ttc, "s"),
    "DRAC above 7.0 m/s²": lambda s: beyond(s.safety.drac, "m/s²"),
    "Unavoidable": lambda s: collisions(s.safety.conflicts.unavoidable, s),
    "Planner's failures": lambda s: collisions(s.safety.conflicts.planner_failures, s),
    "Not classified": lambda s: collisions(s.safety.conflicts.unclassified, s),
    "Lead time of MinTTC": lambda s: lead(s.safety.conflicts.ttc_lead),
    "Lead time of DRAC": lambda s: lead(s.safety.conflicts.drac_lead),
    "Mean severity [m²/s²]": lambda s: risk(s, s.safety.severity.mean),
    f"Severity, VaR at {100.0 * LEVEL:g} % [m²/s²]": lambda s: risk(s, s.safety.severity.var),
    f"Severity, CVaR at {100.0 * LEVEL:g} % [m²/s²]": lambda s: risk(s, s.safety.severity.cvar),
}
