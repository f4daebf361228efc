"""The answer about a risk as tables and sentences, for terminals and pages."""

from collections.abc import Iterator

from eigenfail.presentation.figures import (
    DIGITS,
    UNKNOWN,
    format_count,
    format_interval,
    format_number,
    format_share,
    round_down,
    round_up,
)
from eigenfail.presentation.tables import Block, Cell, FormattedCell, Table, TableColumn
from eigenfail_assurance.risk import assessment
from eigenfail_assurance.risk.allocation import Allocation

SCENARIO = TableColumn("Scenario", is_figure=False)

MOST_EXPOSURE = 0.5
"""Share of the variance from which on exposure is named as the larger part."""

MOST_DIGITS = 12
"""Digits of a float that are its own; further ones are rounding errors."""

NONE_OBSERVED = "none observed"
"""Estimate where nothing was seen: the bound next to it says how many there may be."""

EACH_OF_95 = "Upper bounds are one-sided, of 95 % for each class alone."

NO_CLASS_BOUNDED = (
    "No class is bounded: that needs Monte Carlo in each scenario, ended by no stop rule on "
    "failures, with the severities of its own failures."
)

ALL_OF_95 = "Bounds are one-sided, intervals two-sided, all of 95 %."


def describe_assessment(found: assessment.RiskAssessment) -> Iterator[Block]:
    """Yield the verdict, the totals, the scenarios, the classes, and the best next episodes."""
    yield describe_verdict(found)
    yield ""
    for table in list_tables(found):
        yield table
        yield ""
    yield from describe_allocation(found.next)
    yield from list_limits(found)


def format_target(target: float) -> str:
    """Return a target with as many digits as it has: fewer would state more than was shown."""
    texts = (format_number(target, digits) for digits in (1, 2, 3))
    exact = (
        text for digits, text in enumerate(texts, 1) if float(f"{target:.{digits}g}") == target
    )
    return next(exact, f"{target:.12g}")


def list_tables(found: assessment.RiskAssessment) -> Iterator[Table]:
    """Yield the totals, the scenarios and the classes of severity."""
    yield _tabulate_totals(found)
    yield _tabulate_scenarios(found)
    if found.severity:
        yield _tabulate_severity(found)


def describe_verdict(found: assessment.RiskAssessment) -> str:
    """Return what the bounds show about the target, as a sentence."""
    target, unit, figure = _find_target(found)
    name, wanted = found.question.name, f"the target of {format_target(target)} {unit}"
    few = ", ".join(f"'{each.scenario}'" for each in found.scenarios if each.problem)
    if found.verdict is assessment.RiskVerdict.NOT_MET:
        low = _format_above(figure.at_least or 0.0, target)
        alone = f" That is without {few}, of which there is no estimate." if few else ""
        return f"{name}: not met. Failures are at least {low} {unit}, above {wanted}.{alone}"
    if few:
        return (
            f"{name}: undecided. {wanted[:1].upper()}{wanted[1:]} cannot be judged without an "
            f"estimate for {few}."
        )
    if figure.value == 0.0:
        return _describe_none(found, figure, target, unit)
    if found.verdict is assessment.RiskVerdict.MET:
        high = _format_within(figure.at_most or 0.0, target)
        return f"{name}: met. Failures are at most {high} {unit}, which {wanted} allows."
    low = format_number(round_down(figure.at_least or 0.0))
    high = format_number(round_up(figure.at_most or 0.0))
    return f"{name}: undecided. Failures are {low} to {high} {unit}, around {wanted}."


def _describe_none(
    found: assessment.RiskAssessment, figure: assessment.RiskFigure, target: float, unit: str
) -> str:
    """Return the verdict if no failure was observed: the bound comes first."""
    name, wanted = found.question.name, f"the target of {format_target(target)} {unit}"
    most = figure.at_most or 0.0
    if found.verdict is assessment.RiskVerdict.MET:
        high, said = _format_within(most, target), f"{wanted} allows as many"
    else:
        high, said = format_number(round_up(most)), f"{wanted} is below that bound"
    return (
        f"Failures are at most {high} {unit}, and none was observed. {name}: {found.verdict}. "
        f"{said[:1].upper()}{said[1:]}."
    )


def _format_above(low: float, target: float) -> str:
    """Return a lower bound above the target with as many digits as show that it is above."""
    enough = (each for each in range(DIGITS, MOST_DIGITS) if round_down(low, each) > target)
    digits = next(enough, MOST_DIGITS)
    return format_number(round_down(low, digits), digits)


def _format_within(high: float, target: float) -> str:
    """Return an upper bound within the target with as many digits as show that it is within."""
    enough = (each for each in range(DIGITS, MOST_DIGITS) if round_up(high, each) <= target)
    digits = next(enough, MOST_DIGITS)
    return format_number(round_up(high, digits), digits)


def _find_target(found: assessment.RiskAssessment) -> tuple[float, str, assessment.RiskFigure]:
    """Return the target with its unit, and the figure that is compared with it."""
    target = found.question.target
    if target.per_million_km is None or found.per_million_km is None:
        return target.per_hour or 0.0, "per hour", found.per_hour
    return target.per_million_km, "per 10⁶ km", found.per_million_km


def list_limits(found: assessment.RiskAssessment) -> Iterator[str]:
    """Yield why estimates are missing, and what else limits the answer."""
    for each in found.scenarios:
        if each.problem:
            yield f"No estimate for '{each.scenario}': {each.problem}"
    yield from found.notes
    exact = [each for each in found.scenarios if each.encounters_per_hour.interval is None]
    if exact:
        names = ", ".join(f"'{each.scenario}'" for each in exact)
        yield f"Encounters with {names} are taken to be known exactly: no interval is given."
    yield (
        "The total is that of these scenarios alone, met as often as stated, with noise of the "
        "campaigns' disturbance models. Failures that no sample came near are not in it."
    )


def _tabulate_totals(found: assessment.RiskAssessment) -> Table:
    figures = (("per hour", found.per_hour), ("per 10⁶ km", found.per_million_km))
    columns = (
        TableColumn("Failures", is_figure=False),
        *map(TableColumn, ("Estimate", "95 % interval", "At least", "At most")),
    )
    rows = tuple((unit, *_list_cells(figure)) for unit, figure in figures if figure is not None)
    return Table("Total", columns, rows, (ALL_OF_95,))


def _list_cells(figure: assessment.RiskFigure) -> tuple[Cell, ...]:
    low, high = figure.at_least, figure.at_most
    return (
        NONE_OBSERVED if figure.value == 0.0 else figure.value,
        UNKNOWN if figure.interval is None else format_interval(figure.interval),
        UNKNOWN if low is None else format_number(round_down(low)),
        UNKNOWN if high is None else format_number(round_up(high)),
    )


def _format_figure(figure: assessment.RiskFigure) -> FormattedCell:
    interval = "" if figure.interval is None else format_interval(figure.interval)
    return FormattedCell(format_number(figure.value), interval)


def _tabulate_scenarios(found: assessment.RiskAssessment) -> Table:
    columns = (
        SCENARIO,
        TableColumn("Met per hour [95 %]"),
        TableColumn("Campaigns", is_figure=False),
        TableColumn("Method", is_figure=False),
        TableColumn("Episodes"),
        TableColumn("Failures"),
        TableColumn("P(failure) [95 %]"),
        TableColumn("Failures per hour [95 %]"),
        TableColumn("Share", "share"),
    )
    return Table("Scenarios", columns, tuple(map(_list_scenario, found.scenarios)))


def _list_scenario(each: assessment.ScenarioRisk) -> tuple[Cell, ...]:
    return (
        each.scenario,
        _format_figure(each.encounters_per_hour),
        ", ".join(map(str, each.campaigns)) or UNKNOWN,
        each.method or UNKNOWN,
        each.episodes,
        each.failures,
        _format_figure(each.probability),
        _format_figure(each.per_hour),
        each.share,
    )


def _tabulate_severity(found: assessment.RiskAssessment) -> Table:
    columns = (
        TableColumn("Severity", "m²/s²", is_figure=False),
        TableColumn("Failures per hour"),
        TableColumn("At most"),
        TableColumn("Share", "share"),
        TableColumn("Counted"),
    )
    rows = tuple(map(_list_class, found.severity))
    notes = ["Severity is in m²/s². Shares are those of the counted failures of each scenario."]
    is_bounded = all(each.at_most is not None for each in found.severity)
    notes.append(EACH_OF_95 if is_bounded else NO_CLASS_BOUNDED)
    return Table("Severity", columns, rows, tuple(notes))


def _list_class(each: assessment.SeverityRate) -> tuple[Cell, ...]:
    is_seen = bool(each.per_hour or each.counted)
    high = UNKNOWN if each.at_most is None else format_number(round_up(each.at_most))
    return (
        each.name,
        each.per_hour if is_seen else NONE_OBSERVED,
        high,
        each.share if is_seen else UNKNOWN,
        each.counted,
    )


def describe_allocation(found: Allocation) -> Iterator[Block]:
    """Yield the best division of the next episodes, as a table with sentences."""
    columns = (
        SCENARIO,
        TableColumn("Next episodes"),
        TableColumn("Standard error now", "1/h"),
        TableColumn("Then", "1/h"),
    )
    rows = tuple((each.scenario, each.episodes, each.now, each.then) for each in found.shares)
    yield Table(f"Next {format_count(found.episodes)} episodes", columns, rows)
    if any(each.now is None for each in found.shares):
        yield (
            "Scenarios without an estimate get an equal part for a first one; their error is not "
            "in the total's."
        )
    if not found.now:
        return
    yield (
        f"The next {format_count(found.episodes)} episodes, divided like this, are expected to "
        f"take the standard error of the total from {format_number(found.now)} to "
        f"{format_number(found.then)} per hour."
    )
    if found.exposure is not None and found.exposure > MOST_EXPOSURE:
        yield (
            f"{format_share(found.exposure)} of the variance is due to how often scenarios are "
            "met, which no episode reduces: more hours of driving help more."
        )
