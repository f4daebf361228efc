"""Safety measures, learning curves, and likelihood against severity."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from eigenfail.presentation import figures, svg
from eigenfail.presentation.rates import FAILED_SHARE, name_rates
from eigenfail.values.estimates import Interval, Rate
from eigenfail.values.records import IN_WORDS
from eigenfail.values.safety import TAIL_LEVEL, FailurePoint, SeverityRisk, Violations
from eigenfail.values.safety import Figure as Number
from eigenfail.values.summary import CourseBlock, MeanTime
from eigenfail_reports import page
from eigenfail_reports.contents import OWN_EPISODES, Cell, ReportPicture
from eigenfail_reports.material import Material, Subject, sample_note
from eigenfail_reports.outcomes import list_bounds

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SAFETY_COLUMNS = (
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
    "MinTTC below 1.5 s without a collision. A collision is unavoidable if DRAC was more than the "
    "ego's brakes can do (7.0 m/s² unless another limit is stated) when TTC first fell below "
    "1.5 s, or if nothing showed before the contact. Any other collision is a planner failure: it "
    "is not shown to be unavoidable. Lead times end at the collision."
)


FUNCTION_WORDS = (
    "A failure of a function is an episode in which its answer, the robustness, is 0 or less."
)


def make_safety(material: Material) -> page.ReportPart:
    """The measures side by side."""
    subjects = material.subjects
    rows = [row for subject in subjects for row in list_measure_rows(subject)]
    return page.ReportPart(
        name="safety",
        title="Safety measures",
        words=(
            material.pick_words(HOW_TO_READ, FUNCTION_WORDS),
            *(note for subject in subjects for note in list_notes(subject)),
        ),
        tables=(
            page.make_table(
                "safety", "Safety measures of all completed episodes", SAFETY_COLUMNS, rows
            ),
        ),
        grids={"safety": page.make_comparison_grids(subjects, choose_figures(material))},
    )


def choose_figures(material: Material) -> Mapping[str, Callable[[Subject], tuple[str, ...]]]:
    """Return the rows of the table: no measures of traffic if every campaign has a function."""
    names = [each.name for one in material.subjects for each in one.safety.requirements]
    if names:
        violations = {f"Violates {name}": count_violations(name) for name in dict.fromkeys(names)}
        collisions = {"Collisions": lambda s: format_count(s.safety.collisions)}
        return {"Failures": count_failures, **collisions, **violations, **TRAFFIC}
    if not material.has_functions:
        return {"Collisions": count_failures, **TRAFFIC}
    measured = {name: _omit_of_functions(figure) for name, figure in TRAFFIC.items()}
    return {"Failures": count_failures, **(measured if material.has_roads else {})}


def _omit_of_functions(
    figure: Callable[[Subject], tuple[str, ...]],
) -> Callable[[Subject], tuple[str, ...]]:
    return lambda subject: figure(subject) if subject.has_road else (figures.UNKNOWN,)


def list_notes(subject: Subject) -> tuple[str, ...]:
    """Return the limits of a campaign's figures."""
    found = subject.safety
    problem = (found.severity.problem,) if found.severity.n else ()
    sentences = (*found.notes, *filter(None, problem))
    return tuple(f"Campaign {subject.id}: {note}" for note in sentences)


def list_measure_rows(subject: Subject) -> list[tuple[Cell, ...]]:
    """Return a row for each measure: a count, or statistics over n episodes.

    A function has a row for its failures alone.
    """
    found = subject.safety
    if not subject.has_road:
        return [(subject.id, "failures", *format_safety_share(found.failures))]
    conflicts, collided = found.conflicts, found.conflicts.collisions
    rows = (
        *([("failures", *format_safety_share(found.failures))] if found.requirements else []),
        ("collisions", *format_safety_share(found.collisions)),
        *(
            (f"violations of {each.name}", *format_safety_share(each.violations))
            for each in found.requirements
        ),
        ("near misses", *format_safety_share(found.near_misses)),
        ("unresolved at the horizon", *count(found.unresolved.count, found.completed)),
        ("MinTTC below threshold", *format_safety_share(found.ttc.beyond)),
        ("MinTTC median", None, found.ttc.n, found.ttc.median, None, None, "s"),
        ("MinTTC worst", None, found.ttc.n, found.ttc.worst, None, None, "s"),
        ("DRAC above threshold", *format_safety_share(found.drac.beyond)),
        ("DRAC median", None, found.drac.n, found.drac.median, None, None, "m/s²"),
        ("DRAC worst", None, found.drac.n, found.drac.worst, None, None, "m/s²"),
        ("collisions, unavoidable", *count(conflicts.unavoidable, collided)),
        ("collisions, planner failures", *count(conflicts.planner_failures, collided)),
        ("collisions, not classified", *count(conflicts.unclassified, collided)),
        ("mean lead time of MinTTC", *make_mean_row(conflicts.ttc_lead)),
        ("mean lead time of DRAC", *make_mean_row(conflicts.drac_lead)),
        ("severity mean", *make_severity_row(found.severity, found.severity.mean)),
        (
            f"severity VaR {found.severity.level:g}",
            *make_severity_row(found.severity, found.severity.var),
        ),
        (
            f"severity CVaR {found.severity.level:g}",
            *make_severity_row(found.severity, found.severity.cvar),
        ),
    )
    return [(subject.id, *row) for row in rows]


def format_safety_share(found: Rate | None) -> tuple[Cell, ...]:
    """k of n as a share with its interval."""
    if found is None:
        return (None, None, None, None, None, "share")
    return (found.k, found.n, found.value, *list_bounds(found), "share")


def count(k: int, n: int) -> tuple[Cell, ...]:
    """k of n."""
    return (k, n, None, None, None, "")


def make_mean_row(found: MeanTime) -> tuple[Cell, ...]:
    """Return the row of a mean time."""
    return (None, found.n, found.mean_s, None, None, "s")


def make_severity_row(risk: SeverityRisk, found: Number | None) -> tuple[Cell, ...]:
    """Return the row of a figure of the failures' severity with its interval."""
    bounds = found.interval if found else None
    value = found.value if found else None
    ends = (bounds.low, bounds.high) if bounds else (None, None)
    return (None, risk.n, value, *ends, "m²/s²")


def format_count(found: Rate | None) -> tuple[str, ...]:
    """Return k of n, and the share."""
    if found is None:
        return (figures.UNKNOWN, "no episode completed")
    if found.interval is None:
        return (f"{found.k:,} of {found.n:,}", OWN_EPISODES)
    return (
        f"{found.k:,} of {found.n:,}",
        f"95 %: {figures.format_percent_interval(found.interval)}",
    )


def format_exceedance(found: Violations, unit: str) -> tuple[str, ...]:
    """Return how often a threshold was passed, and the median and worst value."""
    middle, worst = figures.format_number(found.median), figures.format_number(found.worst)
    return (
        *format_count(found.beyond),
        f"median {middle} {unit}, worst {worst} {unit} (n = {found.n:,})",
    )


def format_collisions(k: int, subject: Subject) -> tuple[str, ...]:
    """Return k of the campaign's collisions as text; unknown if it has none."""
    count = subject.safety.conflicts.collisions
    return (f"{k:,} of {count:,} collisions",) if count else (figures.UNKNOWN,)


def format_lead(found: MeanTime) -> tuple[str, ...]:
    """Return a mean lead time with its number of failures."""
    if found.mean_s is None:
        return (figures.UNKNOWN, "no such collision")
    return (f"{figures.format_number(found.mean_s)} s", f"mean of {found.n:,}")


def format_risk(subject: Subject, found: Number | None) -> tuple[str, ...]:
    """Return a figure of severity with its interval as text."""
    n = f"n = {subject.safety.severity.n:,}"
    if found is None:
        return (figures.UNKNOWN, n)
    bounds = f"95 %: {figures.format_interval(found.interval)}, " if found.interval else ""
    return (figures.format_number(found.value), f"{bounds}{n}")


def count_failures(subject: Subject) -> tuple[str, ...]:
    """Return how many of the completed episodes failed."""
    return format_count(subject.safety.failures)


def count_violations(name: str) -> Callable[[Subject], tuple[str, ...]]:
    """Return a function that counts the violations of a requirement, by its name."""

    def find(subject: Subject) -> tuple[str, ...]:
        named = {each.name: each.violations for each in subject.safety.requirements}
        return format_count(named[name]) if name in named else (figures.UNKNOWN,)

    return find


TRAFFIC: Mapping[str, Callable[[Subject], tuple[str, ...]]] = {
    "Near misses": lambda s: format_count(s.safety.near_misses),
    "Unresolved at the horizon": lambda s: (
        f"{s.safety.unresolved.count:,} of {s.safety.completed:,}",
    ),
    "MinTTC below 1.5 s": lambda s: format_exceedance(s.safety.ttc, "s"),
    "DRAC above 7.0 m/s²": lambda s: format_exceedance(s.safety.drac, "m/s²"),
    "Unavoidable": lambda s: format_collisions(s.safety.conflicts.unavoidable, s),
    "Planner failures": lambda s: format_collisions(s.safety.conflicts.planner_failures, s),
    "Not classified": lambda s: format_collisions(s.safety.conflicts.unclassified, s),
    "Lead time of MinTTC": lambda s: format_lead(s.safety.conflicts.ttc_lead),
    "Lead time of DRAC": lambda s: format_lead(s.safety.conflicts.drac_lead),
    "Mean severity [m²/s²]": lambda s: format_risk(s, s.safety.severity.mean),
    f"Severity, VaR at {100.0 * TAIL_LEVEL:g} % [m²/s²]": lambda s: format_risk(
        s, s.safety.severity.var
    ),
    f"Severity, CVaR at {100.0 * TAIL_LEVEL:g} % [m²/s²]": lambda s: format_risk(
        s, s.safety.severity.cvar
    ),
}


LIKELIHOOD_TABLE = "failures"


PICTURE = "likelihood-severity"


LIKELIHOOD_COLUMNS = (
    ("campaign", "Campaign"),
    ("episode", "Episode"),
    ("log_p_per_step", "log p per step", "nat"),
    ("severity", "Severity", "m²/s²"),
    ("conflict", "Class"),
)


LIKELIHOOD_WORDS = (
    "Each mark is one failure. Up are the severe ones, to the right the likely ones: those up and "
    "to the right matter most."
)


NONE_FOUND = "No failure has been found, so there is nothing to draw."


NOT_SEVERE = "No failure has a severity, so there is nothing to draw."


def make_likelihood(material: Material) -> page.ReportPart:
    """The failures of all campaigns."""
    failing = [subject for subject in material.subjects if subject.safety.scatter.points]
    rows = [
        list_likelihood(each.id, point) for each in failing for point in each.safety.scatter.points
    ]
    notes = " ".join(filter(None, map(describe_left_out, failing)))
    return page.ReportPart(
        name="likelihood",
        title="Likelihood and severity of failures",
        words=(*list_likelihood_words(material, failing), *list_unmeasured(material)),
        tables=(page.make_table(LIKELIHOOD_TABLE, "Failures", LIKELIHOOD_COLUMNS, rows, notes),),
        pictures=tuple(
            (describe_likelihood_picture(name, group), draw_likelihood(group))
            for name, group in page.name_groups(failing, PICTURE)
        ),
    )


def list_likelihood_words(material: Material, failing: list[Subject]) -> Iterator[str]:
    """Yield how to read the picture, or why it is missing; functions alone do not have one."""
    if failing:
        yield LIKELIHOOD_WORDS
        yield from list_correlations(failing)
    elif any(each.has_road and each.summary.counts.failures for each in material.subjects):
        yield NOT_SEVERE
    elif not any(each.summary.counts.failures for each in material.subjects):
        yield NONE_FOUND


def list_unmeasured(material: Material) -> Iterator[str]:
    """Yield which failures are not drawn, since failures of a function do not have a severity."""
    for each in material.subjects:
        failures = each.summary.counts.failures
        if failures and not each.has_road:
            yield (
                f"Campaign {each.id}: severity is not measured for a function, so that its "
                f"{figures.count_noun(failures, 'failure')} "
                f"{'is' if failures == 1 else 'are'} not drawn."
            )


def list_likelihood(campaign: int, point: FailurePoint) -> tuple[Cell, ...]:
    """The numbers of a failure."""
    conflict = IN_WORDS[point.conflict] if point.conflict else None
    return (campaign, point.index, point.log_probability_per_step, point.severity, conflict)


def describe_left_out(subject: Subject) -> str:
    """Return whether all failures of a campaign are shown."""
    scatter = subject.safety.scatter
    note = sample_note(len(scatter.points), scatter.of, "failures")
    return f"Campaign {subject.id}: {note}" if note else ""


def list_correlations(failing: list[Subject]) -> Iterator[str]:
    """Yield whether severe failures are less likely, for each campaign with failures."""
    for subject in failing:
        found, n = subject.safety.scatter.rank_correlation, len(subject.safety.scatter.points)
        if found is not None:
            bounds = f" {figures.format_interval(found.interval)}" if found.interval else ""
            yield (
                f"Campaign {subject.id}: rank correlation of severity and log p per step (Spearman)"
                f" {figures.format_number(found.value)}{bounds}, n = {n:,}; below 0 the severe "
                "failures are the rarer ones."
            )


def describe_likelihood_picture(name: str, group: tuple[Subject, ...]) -> ReportPicture:
    """Return the description of the picture of some campaigns."""
    return ReportPicture(
        name=name,
        title="Likelihood and severity of failures",
        alternative=" ".join(map(describe_likelihood, group)),
        table=LIKELIHOOD_TABLE,
        campaigns=tuple(subject.id for subject in group),
        note=" ".join(filter(None, map(describe_left_out, group))),
    )


def describe_likelihood(subject: Subject) -> str:
    """Return the ranges of likelihood and severity of a campaign's failures, as a sentence."""
    points = subject.safety.scatter.points
    likely = [point.log_probability_per_step for point in points]
    severe = [point.severity for point in points]
    return (
        f"Campaign {subject.label}: {len(points)} failures, log p per step from "
        f"{figures.format_number(min(likely))} to {figures.format_number(max(likely))}, severity "
        f"from {figures.format_number(min(severe))} to {figures.format_number(max(severe))} m²/s²."
    )


def draw_likelihood(group: tuple[Subject, ...]) -> svg.Drawing:
    """A mark for each failure."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for subject in group:
            points = subject.safety.scatter.points
            axes.plot(
                [point.log_probability_per_step for point in points],
                [point.severity for point in points],
                linestyle="none",
                marker=svg.pick_mark(subject.place).marker,
                markerfacecolor="none",
                markeredgecolor=svg.pick_mark(subject.place).colour,
                markeredgewidth=0.9,
                label=subject.label,
            )
        axes.set_xlabel("log p per step [nat]")
        axes.set_ylabel("severity ‖Δv‖² [m²/s²]")
        axes.set_ylim(bottom=0.0)
        page.draw_legend(axes)

    return svg.Drawing(draw, 3.4 + 0.16 * len(group))


LEARNING_TABLE = "learning-curve"


LEARNING_COLUMNS = (
    ("campaign", "Campaign"),
    ("first", "First episode"),
    ("last", "Last episode"),
    ("n", "Episodes completed"),
    ("failures", "Failures"),
    ("failure_rate", FAILED_SHARE, "share"),
    ("failure_rate_low", "from", "share"),
    ("failure_rate_high", "to", "share"),
    ("log_p_per_step", "log p per step of the failures", "nat"),
)


LEARNING_WORDS = (
    "Share of episodes that failed by blocks of neighbouring episodes, and log p per step of the "
    "failures in each block. Where episodes are drawn from p(x) the share is the failure rate, and "
    "has a 95 % interval; the episodes of a search were chosen by it. Only a method that learns "
    "has a learning curve: with the others a change over the episodes is chance."
)


def make_learning(material: Material) -> page.ReportPart:
    """The courses of the campaigns."""
    begun = [subject for subject in material.subjects if subject.course.blocks]
    rows = [list_learning(subject, block) for subject in begun for block in subject.course.blocks]
    columns = (
        *LEARNING_COLUMNS,
        ("smallest_robustness_m", "Smallest robustness", material.robustness_unit),
        ("median_robustness_m", "Median robustness", material.robustness_unit),
    )
    return page.ReportPart(
        name="learning",
        title="Learning curve",
        words=(LEARNING_WORDS,) if begun else ("No episode has ended yet.",),
        tables=(page.make_table(LEARNING_TABLE, "Failures over episodes", columns, rows),),
        pictures=tuple(
            (describe_learning_picture(name, group), draw_learning(group))
            for name, group in page.name_groups(begun, LEARNING_TABLE)
        ),
    )


def list_learning(subject: Subject, block: CourseBlock) -> tuple[Cell, ...]:
    """The numbers of a block."""
    rate = block.failure_rate
    return (
        subject.id,
        block.first,
        block.last,
        rate.n,
        rate.k,
        rate.value,
        *list_bounds(rate),
        block.log_probability_per_step,
        block.smallest_robustness_m,
        block.median_robustness_m,
    )


def describe_learning_picture(name: str, group: tuple[Subject, ...]) -> ReportPicture:
    """Return the description of the picture of some campaigns."""
    return ReportPicture(
        name=name,
        title=f"{_name_rates(group)} and likelihood of failures over episodes",
        alternative=" ".join(map(describe_learning, group)),
        table=LEARNING_TABLE,
        campaigns=tuple(subject.id for subject in group),
    )


def describe_learning(subject: Subject) -> str:
    """How the failure rate, or share of failures, of a campaign moved."""
    first, last = subject.course.blocks[0].failure_rate, subject.course.blocks[-1].failure_rate
    return (
        f"Campaign {subject.label}: {_name_rates([subject]).lower()} "
        f"{figures.format_share(first.value)} in the first block "
        f"of up to {subject.course.per} episodes, {figures.format_share(last.value)} in the last."
    )


def _name_rates(group: Sequence[Subject]) -> str:
    return name_rates(block.failure_rate for each in group for block in each.course.blocks)


def draw_learning(group: tuple[Subject, ...]) -> svg.Drawing:
    """Failure rate, or share of failures, above, likelihood below."""

    def draw(figure: "Figure") -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for subject in group:
            look, blocks = svg.pick_mark(subject.place), subject.course.blocks
            middle = [(block.first + block.last) / 2.0 for block in blocks]
            rates = [block.failure_rate for block in blocks]
            bounds = [rate.interval or Interval(rate.share, rate.share) for rate in rates]
            pairs = list(zip(rates, bounds, strict=True))
            down = [100.0 * (rate.share - each.low) for rate, each in pairs]
            up = [100.0 * (each.high - rate.share) for rate, each in pairs]
            above.errorbar(
                middle,
                [100.0 * rate.share for rate in rates],
                yerr=[[max(each, 0.0) for each in down], [max(each, 0.0) for each in up]],
                capsize=2.0,
                elinewidth=0.8,
                label=subject.label,
                **look.style,
            )
            likely = [block.log_probability_per_step for block in blocks]
            known = [(at, value) for at, value in zip(middle, likely, strict=True) if value]
            if known:
                below.plot(*zip(*known, strict=True), **look.style)
        above.set_ylabel(f"{_name_rates(group).lower()} [%]")
        below.set_ylabel("log p per step [nat]")
        below.set_xlabel("episode")
        page.draw_legend(above)

    return svg.Drawing(draw, 4.0 + 0.16 * len(group))
