"""Tables of campaigns: specification, results, severity and cost."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from msgspec import UnsetType

from eigenfail.presentation import tables
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_count,
    format_duration,
    format_local_time,
    format_number,
    format_quantity,
    format_share,
)
from eigenfail.presentation.rates import name_rates
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.comparison import Comparison, Side
from eigenfail.values.estimates import Estimate, Rate
from eigenfail.values.operations import WorkerShare
from eigenfail.values.safety import Figure, Safety, Violations
from eigenfail.values.summary import CampaignCost, Conflicts, CostPoint, Course, Summary
from eigenfail.values.variation import in_words
from eigenfail.versions import describe_mixed
from eigenfail.worlds import describe_disturbance, describe_requirements, world_of

ID = tables.TableColumn("Id")
RATE = tables.TableColumn("Failed [95 %]")
LIKELIHOOD = tables.TableColumn("log p/step", "nats")
SEVERITY = tables.TableColumn("Severity", "m²/s²")
COST = tables.TableColumn("USD/failure [95 %]")
PROBABILITY = tables.TableColumn("P(failure) [95 %]")
"""A column that tables have where a campaign has an estimate."""

RESULTS = (
    tables.read_number("Episodes", "counts.completed"),
    tables.read_number("Failures", "counts.failures"),
    tables.Reading(RATE, "failure_rate"),
    tables.Reading(LIKELIHOOD, "log_probability_per_step"),
    tables.Reading(SEVERITY, "mean_severity"),
    tables.Reading(COST, "cost"),
)
"""What tables show of the summary of a campaign."""
SPEED = tables.read_number("Episodes/s", "episodes_per_s")
WITH_SPEED = (*RESULTS[:-1], SPEED, RESULTS[-1])
PARTS_OF_TIME = {
    "simulation_s": "simulation",
    "startup_s": "start-up",
    "learning_s": "learning",
    "waiting_s": "waiting",
    "lost_s": "lost",
}
SEARCHES = (
    '"Of its search" is a share of the episodes that the method chose, no failure rate under p(x); '
    "the cost per failure rests on the same episodes."
)
STEPS_OF_COST = 10
"""Number of rows of the table of failures by cost."""
ROUNDING = 1e-9
"""Relative error of amounts that were divided and multiplied again."""


def tabulate_results(summaries: Iterable[Summary]) -> tables.Table:
    """Return the findings and costs of campaigns, one a row, with remarks on their rates."""
    found = list(summaries)
    # Few methods estimate a probability: without one the column would hold dashes alone.
    last = [tables.Reading(PROBABILITY, "estimate")] if any(each.estimate for each in found) else []
    return tables.tabulate(
        "Results",
        found,
        tables.Reading(ID, lambda each: str(each.campaign)),
        tables.read_text("Method", "method"),
        *WITH_SPEED,
        *last,
        notes=note_results(found),
    )


def note_results(summaries: Iterable[Summary]) -> tuple[str, ...]:
    """Return the remarks on failure rates and probabilities of campaigns."""
    found = list(summaries)
    # Methods share the reasons for their bounds: each is given once.
    bounds = (each.estimate.note for each in found if each.estimate and each.estimate.bound)
    searches = [each for each in found if each.failure_rate and not each.failure_rate.sampled]
    return (
        *((SEARCHES,) if searches else ()),
        *(f"Campaign {each.campaign}: {each.remark}" for each in found if each.remark),
        *(f"At least: {reason}" for reason in dict.fromkeys(bounds)),
    )


def tabulate_campaigns(campaigns: Iterable[Campaign]) -> tables.Table:
    """Return a list of campaigns."""
    found = list(campaigns)
    has_estimate = any(campaign.estimate for campaign in found)
    return tables.tabulate(
        "Campaigns",
        found,
        tables.Reading(ID, lambda each: str(each.id)),
        tables.read_text("Name", "spec.name"),
        tables.read_text("State", "state_word"),
        tables.read_text("Method", "spec.method"),
        tables.read_text("Scenario", "spec.scenario"),
        tables.read_text("Planner", "spec.planner"),
        tables.read_number("Done", _format_progress),
        tables.read_number("Failures", "counts.failures"),
        *([tables.Reading(PROBABILITY, "estimate")] if has_estimate else []),
        tables.read_text("Created", lambda each: format_local_time(each.created_ms)),
    )


def _format_progress(campaign: Campaign) -> str:
    counts = campaign.counts
    return f"{format_count(counts.completed + counts.errored)}/{format_count(counts.planned)}"


def list_campaign_facts(campaign: Campaign) -> tables.FactTable:
    """Return the specification of a campaign, and its progress."""
    spec, counts, archived_ms = campaign.spec, campaign.counts, campaign.archived_ms
    parameters, limits = in_words(spec.scenario_parameters), spec.stop.given()
    stops = f"; stops at {_join_settings(limits)}" if limits else ""
    trained, archived = (
        campaign.trained_episodes,
        f"{format_local_time(archived_ms)}: lists omit it",
    )
    rows = [
        ("campaign", f"{campaign.id}: {spec.name}"),
        ("state", " ".join(filter(None, (campaign.state_word, campaign.stopped_because)))),
        ("method", f"{spec.method} {spec.settings or ''}"),
        ("scenario", " ".join((spec.scenario, _join_settings(parameters)))),
        ("planner", f"{spec.planner} {spec.planner_settings or ''}"),
        *list_labels(spec),
        ("simulator", f"{spec.simulator}, seed {spec.seed}"),
        ("disturbance", "; ".join(map(" ".join, describe_disturbance(spec).items()))),
        *describe_requirements(spec).items(),
        ("budget", f"{format_count(spec.episodes)} episodes{stops}"),
        ("priority", spec.priority),
        ("episodes", ", ".join(_list_ended(campaign))),
        ("failures", format_count(counts.failures)),
        *_list_estimate(campaign.estimate),
        *([("trained with", f"{format_count(trained)} episodes")] if trained is not None else []),
        ("created", format_local_time(campaign.created_ms)),
        *([("archived", archived)] if archived_ms is not None else []),
        ("active", f"{format_number(campaign.active_s)} s"),
        ("digest", campaign.digest or UNKNOWN),
        *(("versions", sentence) for sentence in describe_mixed(campaign)),
    ]
    return tables.FactTable("Campaign", tuple(rows))


def list_labels(spec: CampaignSpec) -> Iterator[tuple[str, str]]:
    """Yield a campaign's planner version, project and tags, if they are given."""
    given = {
        "planner version": spec.version,
        "project": "" if isinstance(spec.project, UnsetType) else spec.project,
        "tags": ", ".join(spec.all_tags),
    }
    return ((name, text) for name, text in given.items() if text)


def _join_settings(settings: Mapping[str, object]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in settings.items())


def _list_estimate(estimate: Estimate | None) -> Iterator[tuple[str, str]]:
    if estimate is None:
        return
    known = "unknown" if estimate.probability is None else tables.format_line(estimate)
    # Beside a lower bound a small cv would look like certainty about the probability itself.
    has_cv = estimate.cv is not None and not estimate.bound
    certainty = f", cv {format_number(estimate.cv)}" if has_cv else ""
    yield "P(failure)", f"{known}, {estimate.by}{certainty}"
    if remark := estimate.problem or estimate.note:
        yield "", remark


def _list_ended(campaign: Campaign) -> Iterator[str]:
    counts = campaign.counts
    yield f"{format_count(counts.completed)} completed of {format_count(counts.planned)}"
    yield f"{format_count(counts.errored)} errored"
    if counts.cancelled:
        yield f"{format_count(counts.cancelled)} not run"


def describe_campaign(campaign: Campaign, summary: Summary) -> tuple[tables.Block, ...]:
    """Return specification and results of a campaign, and its collisions by class."""
    # A function has no traffic, so that it has no conflicts.
    has_road = world_of(campaign.spec.simulator).has_road
    conflicts = [_list_conflicts(campaign, summary.conflicts)] if has_road else []
    return (list_campaign_facts(campaign), _list_findings(summary), *conflicts)


def _list_findings(summary: Summary) -> tables.FactTable:
    n = f"n = {format_count(summary.counts.failures)}"
    collisions = summary.conflicts.collisions
    rate = tables.format_line(summary.failure_rate)
    searched = summary.failure_rate is not None and not summary.failure_rate.sampled
    chosen = ", chosen by the method" if searched else ""
    rows = (
        (
            name_rates([summary.failure_rate]).lower(),
            f"{rate} (n = {format_count(summary.counts.completed)}{chosen})",
        ),
        *([("", summary.rate_remark)] if summary.rate_remark else []),
        ("log p per step", f"{format_number(summary.log_probability_per_step)} of failures ({n})"),
        (
            # A violation without a collision has none.
            "mean severity",
            f"{format_number(summary.mean_severity)} m²/s² of collisions (n = {collisions:,})",
        ),
        ("cost per failure", f"{tables.format_line(summary.cost)} USD ({n})"),
    )
    return tables.FactTable("Findings", rows)


def _list_conflicts(campaign: Campaign, conflicts: Conflicts) -> tables.FactTable:
    counts = campaign.counts
    found = f"{format_count(conflicts.collisions)} of {format_count(counts.completed)}"
    alone = counts.failures - conflicts.collisions
    leads = (tables.format_line(conflicts.ttc_lead), tables.format_line(conflicts.drac_lead))
    rows = (
        ("collisions", f"{found}: {describe_classes(conflicts)}"),
        *([("violations", f"{format_count(alone)} without a collision")] if alone else []),
        ("near misses", f"{format_count(conflicts.near_misses)} with MinTTC < 1.5 s"),
        ("mean lead time", f"{leads[0]} MinTTC, {leads[1]} DRAC"),
    )
    return tables.FactTable("Conflicts", rows)


def describe_classes(conflicts: Conflicts) -> str:
    """Return the numbers of collisions by class."""
    classes = (
        (conflicts.unavoidable, "unavoidable"),
        (conflicts.planner_failures, "planner failures"),
        *([(conflicts.unclassified, "not classified")] if conflicts.unclassified else []),
    )
    return ", ".join(f"{format_count(count)} {words}" for count, words in classes)


def tabulate_course(course: Course, unit: str = "m") -> tuple[tables.Block, ...]:
    """Return the blocks of a course, one a row, under a heading.

    Args:
        course: blocks of its episodes.
        unit: unit of robustness; empty for a function.
    """
    readings = (
        tables.read_text("Episodes", lambda block: f"{block.first}–{block.last}"),
        tables.read_number("Completed", "failure_rate.n"),
        tables.read_number("Failures", "failure_rate.k"),
        tables.Reading(RATE, "failure_rate"),
        tables.Reading(LIKELIHOOD, "log_probability_per_step"),
        tables.read_number("Median robustness", "median_robustness_m", unit),
    )
    searched = any(not block.failure_rate.sampled for block in course.blocks)
    notes = (SEARCHES,) if searched else ()
    return (
        f"{course.heading} of campaign {course.campaign} ({course.method})",
        tables.tabulate(course.heading, course.blocks, *readings, notes=notes),
    )


def tabulate_safety_measures(found: Safety) -> tables.Table:
    """Return the number of episodes beyond each threshold, the medians and the worst cases.

    For a function, return only the number of failures.
    """
    ttc, drac = found.ttc, found.drac
    counts = (tables.TableColumn("Episodes"), tables.TableColumn("Share [95 %]"))
    # A function has no traffic: all that is measured is whether it failed.
    if not found.measures_traffic:
        failures = ("Failure", *_count_rate(found.failures))
        return tables.Table(
            "Safety measures", (*tables.name_columns("Measure"), *counts), (failures,)
        )
    columns = (
        *tables.name_columns("Measure"),
        *counts,
        *tables.count_columns("Median", "Worst", "n"),
    )
    rows = (
        *_list_failures(found),
        ("Near miss", *_count_rate(found.near_misses), None, None, None),
        (f"MinTTC below {ttc.threshold:g} s", *_list_violations(ttc, "s")),
        (f"DRAC above {drac.threshold:g} m/s²", *_list_violations(drac, "m/s²")),
    )
    return tables.Table("Safety measures", columns, rows)


def _list_failures(found: Safety) -> Iterator[tuple[tables.Cell, ...]]:
    """Yield the row of the failures, and one row for each named requirement."""
    # Without named requirements every failure is a collision, which has a row of its own.
    if found.requirements:
        yield ("Failure", *_count_rate(found.failures), None, None, None)
    yield ("Collision", *_count_rate(found.collisions), None, None, None)
    for each in found.requirements:
        rate, worst = each.violations, format_quantity(each.worst, each.unit)
        robustness = f"robustness {worst}"
        yield (f"Violates {each.name}", *_count_rate(rate), None, robustness, rate and rate.n)


def _count_rate(rate: Rate | None) -> tuple[tables.Cell, tables.Cell]:
    return (None if rate is None else rate.k), rate


def _list_violations(found: Violations, unit: str) -> tuple[tables.Cell, ...]:
    extremes = (format_quantity(found.median, unit), format_quantity(found.worst, unit))
    return (*_count_rate(found.beyond), *extremes, found.n)


def list_severity(found: Safety) -> tuple[tuple[str, tables.FormattedCell], ...]:
    """Return mean, VaR and CVaR of the severity of the failures, and its rank correlation."""
    risk, scatter = found.severity, found.scatter
    level = f"{100.0 * risk.level:g} %"
    n = f"n = {format_count(risk.n)}"
    # A quantile of the tail rests on few failures: their number says how far to trust it.
    beyond = f"{format_number(risk.beyond)} failures beyond"
    points = f"Spearman, n = {format_count(len(scatter.points))}"
    figures = (
        ("Mean severity [m²/s²]", risk.mean, n),
        (f"VaR {level} [m²/s²]", risk.var, beyond),
        (f"CVaR {level} [m²/s²]", risk.cvar, beyond),
        ("Severity against log p, ρ", scatter.rank_correlation, points),
    )
    return tuple((name, _explain_figure(value, basis)) for name, value, basis in figures)


def _explain_figure(value: Figure | None, basis: str) -> tables.FormattedCell:
    if value is None:
        return tables.FormattedCell(UNKNOWN, basis=("too few failures", basis))
    missing = () if value.interval else ("no interval",)
    return tables.format_cell(value)._replace(basis=(*missing, basis))


def describe_safety(found: Safety) -> tuple[tables.Block, ...]:
    """Return the safety measures of a campaign, the classes and the severity of its collisions.

    Failures of a function have neither classes nor severity; a note explains this.
    """
    title = f"Safety measures of campaign {found.campaign}, {found.name} ({found.method}): "
    heading = f"{title}{format_count(found.completed)} episodes"
    measures = tabulate_safety_measures(found)
    notes = tables.list_notes([(found.severity.problem, *found.notes)])
    if not found.measures_traffic:
        return (heading, measures, "", *notes)
    conflicts, severity = found.conflicts, list_severity(found)
    leads = (tables.format_line(conflicts.ttc_lead), tables.format_line(conflicts.drac_lead))
    rows = (
        ("collisions", describe_classes(conflicts)),
        ("mean lead time", f"{leads[0]} MinTTC, {leads[1]} DRAC"),
        *((name, f"{cell.line} ({', '.join(cell.basis)})") for name, cell in severity),
    )
    return (
        heading,
        measures,
        "",
        tables.FactTable("Collisions", rows),
        *notes,
    )


def describe_costs(found: Sequence[CampaignCost]) -> tuple[tables.Block, ...]:
    """Return the costs of campaigns, the use of their time, and their failures over cost."""
    return (
        tabulate_bill(found),
        "",
        tabulate_time(found),
        "",
        _tabulate_purchases(found),
        *(f"Campaign {each.campaign}: {each.modes_in_words}" for each in found),
        *tables.list_notes(each.notes for each in found),
    )


def tabulate_bill(found: Sequence[CampaignCost]) -> tables.Table:
    """Return the cost of each campaign, and the failures and modes it found for that cost."""
    return tables.tabulate(
        "Cost",
        found,
        tables.Reading(ID, lambda each: str(each.campaign)),
        tables.read_text("Name", "name"),
        tables.read_text("Method", "method"),
        tables.read_number("Episodes", "completed"),
        tables.read_number("Failures", "failures"),
        tables.read_number("USD", "cost.total_usd", "USD"),
        tables.Reading(COST, "cost"),
        tables.read_number("Modes", "modes"),
        tables.read_number("USD/mode", "per_mode_usd", "USD"),
    )


def tabulate_time(found: Sequence[CampaignCost]) -> tables.Table:
    """Return the use of the billed time of each campaign."""
    parts = [tables.TableColumn(words.capitalize(), "share") for words in PARTS_OF_TIME.values()]
    columns = (ID, *tables.name_columns("Method"), tables.TableColumn("Active", "s"), *parts)
    rows = tuple((str(each.campaign), each.method, *_list_time(each)) for each in found)
    return tables.Table("Time breakdown", columns, rows)


def _list_time(found: CampaignCost) -> Iterator[tables.Cell]:
    time = found.time
    yield format_quantity(time.active_s, "s")
    for name in PARTS_OF_TIME:
        # Shares of no time are not defined.
        yield getattr(time, name) / time.active_s if time.active_s else None


def list_amounts(found: Iterable[CampaignCost]) -> list[float]:
    """Return evenly spaced amounts [USD] up to the cost of the most expensive campaign."""
    # All campaigns share the amounts, so that what each found by one of them can be compared.
    most = max((each.cost.total_usd for each in found), default=0.0)
    return [most * step / STEPS_OF_COST for step in range(1, STEPS_OF_COST + 1)] if most else []


def find_purchase(found: CampaignCost, spent_usd: float) -> CostPoint | None:
    """Return a campaign's findings after spending an amount; None beyond its total cost."""
    # The last amount is a campaign's total itself, up to the rounding of a division.
    if spent_usd > found.cost.total_usd * (1.0 + ROUNDING):
        return None
    usd = [point.usd for point in found.curve]
    return found.curve[max(bisect_right(usd, spent_usd * (1.0 + ROUNDING)) - 1, 0)]


def _tabulate_purchases(found: Sequence[CampaignCost]) -> tables.Table:
    names = (tables.TableColumn(f"{each.campaign} {each.method}") for each in found)
    return tables.Table(
        "Failures by cost",
        (tables.TableColumn("USD", "USD"), *names),
        tuple(
            (spent, *(_describe_purchase(find_purchase(each, spent)) for each in found))
            for spent in list_amounts(found)
        ),
    )


def _describe_purchase(point: CostPoint | None) -> str:
    if point is None:
        return UNKNOWN
    modes = "" if point.modes is None else f" ({point.modes} modes)"
    return f"{format_count(point.failures)} failures{modes}"


BILLS = (
    tables.TableColumn("Spent", "USD"),
    tables.TableColumn("Cost per distinct mode", "USD"),
    *tables.count_columns(*(f"Time: {words}" for words in PARTS_OF_TIME.values())),
)
SIDES = (*tables.count_columns("Episodes", "Failures"), RATE, LIKELIHOOD, SEVERITY, COST)


def tabulate_sides(found: Comparison, bills: Sequence[Sequence[CampaignCost]] = ()) -> tables.Table:
    """Return the figures of the two sides of a comparison, one a row.

    Args:
        found: the comparison.
        bills: bills of the campaigns of each side; empty to leave out their costs.
    """
    figures = (("A", *_list_side(found.a)), ("B", *_list_side(found.b)))
    columns = (*tables.name_columns("", "Campaigns"), *SIDES)
    if not bills:
        return tables.Table("Figures", columns, figures)
    rows = tuple((*side, *_list_bill(bill)) for side, bill in zip(figures, bills, strict=True))
    return tables.Table("Figures", (*columns, *BILLS), rows)


def _list_bill(costs: Sequence[CampaignCost]) -> tuple[tables.Cell, ...]:
    """Return cost, cost per mode and use of time; several campaigns may share modes: no price."""
    spent = sum(cost.cost.total_usd for cost in costs)
    per_mode = costs[0].per_mode_usd if len(costs) == 1 else "of one campaign at a time"
    return (spent, per_mode, *(_share_time(costs, part) for part in PARTS_OF_TIME))


def _share_time(costs: Sequence[CampaignCost], part: str) -> tables.Cell:
    """Return a part of the time of all campaigns; a dash if one of them did not measure it."""
    active_s = sum(cost.time.active_s for cost in costs)
    known = [part_s for cost in costs if (part_s := getattr(cost.time, part)) is not None]
    if len(known) < len(costs) or active_s <= 0.0:
        return None
    return tables.FormattedCell(
        format_share(sum(known) / active_s), sample=format_duration(sum(known))
    )


def _list_side(side: Side) -> tuple[tables.Cell, ...]:
    return (
        ", ".join(map(str, side.campaigns)),
        side.completed,
        side.failures,
        side.failure_rate,
        side.log_probability_per_step,
        side.mean_severity,
        side.cost,
    )


def describe_comparison(found: Comparison) -> tuple[tables.Block, ...]:
    """Return the figures of two sides, the conclusions, the differing settings, and warnings."""
    differences = tuple((each.thing, each.a, each.b) for each in found.distinctions)
    table = tables.Table("Settings", tables.name_columns("Differs in", "A", "B"), differences)
    return (
        tabulate_sides(found),
        *found.sentences,
        *(("", table) if differences else ()),
        *(f"Warning: {warning}" for warning in found.warnings),
    )


def tabulate_workers(
    shares: Sequence[WorkerShare],
    format_time: Callable[[int], tables.Cell] = format_local_time,
    most: int | None = None,
) -> tables.Table:
    """Return the workers that ran the episodes of a campaign, the busiest first.

    Args:
        shares: shares of all workers.
        format_time: writes the time of the last result.
        most: number of workers to show; None shows all.
    """
    total = sum(share.episodes for share in shares)
    shown = shares[:most]
    # A fleet may have hundreds of workers, and a page has room for the busiest.
    left = f"In the API, with fewer episodes: {count_noun(len(shares) - len(shown), 'worker')}."
    return tables.tabulate(
        "Workers",
        shown,
        tables.read_text("Worker", "worker"),
        tables.read_number("Episodes", "episodes"),
        tables.read_number("Share", lambda each: each.episodes / total if total else None, "share"),
        tables.read_number("Failures", "failures"),
        tables.read_number("Errored", "errored"),
        tables.read_number("Time/episode", lambda each: each.wall_s / each.episodes, "s"),
        tables.read_text("Last result", lambda each: format_time(each.last_ms)),
        notes=(left,) if len(shown) < len(shares) else (),
    )


def tabulate_compared(campaigns: Sequence[Campaign], summaries: Sequence[Summary]) -> tables.Table:
    """Return the results of compared campaigns, one a row."""
    by_id = {campaign.id: campaign for campaign in campaigns}
    return tables.tabulate(
        "Figures",
        summaries,
        tables.read_text("Campaign", lambda each: f"{each.campaign}: {each.name}"),
        tables.read_text("State", lambda each: by_id[each.campaign].state_word),
        *WITH_SPEED,
        tables.read_number("Spent", "cost.total_usd", "USD"),
    )
