"""What a failure costs, method beside method, with the bound of Monte Carlo."""

from collections.abc import Sequence

import msgspec

from eigenfail.values import Rate
from eigenfail.values.campaign import Settings
from eigenfail.values.pool import MethodCost, PeerCosts, Peers
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views import cost_marks
from eigenfail_api.dashboard.views.charts import Chart

MOST_GROUPS = 3


class MethodCosts(msgspec.Struct, frozen=True, kw_only=True):
    """The panel of the first page.

    Attributes:
        charts: one for each group of peers, the newest first.
        notes: what is pooled, what was left out, and whatever else is so of all charts.
    """

    charts: tuple[Chart, ...]
    notes: tuple[str, ...]


def method_costs(groups: Sequence[PeerCosts]) -> MethodCosts:
    """The newest groups in which something was spent and run."""
    told = [group for group in groups if any(priced(each) for each in group.methods)]
    shown = told[:MOST_GROUPS]
    common = [note for note in notes_of(shown) if all(note in group.notes for group in shown)]
    return MethodCosts(
        charts=tuple(group_chart(place, group, common) for place, group in enumerate(shown)),
        notes=(*common, *others(len(told) - len(shown))),
    )


def notes_of(groups: Sequence[PeerCosts]) -> list[str]:
    """All of them, each once."""
    return list(dict.fromkeys(note for group in groups for note in group.notes))


def others(count: int) -> tuple[str, ...]:
    """That there are more groups."""
    groups = formats.counted(count, "older group")
    return (f"In /api/v1/costs: {groups} of campaigns.",) if count > 0 else ()


def priced(found: MethodCost) -> bool:
    """Whether it has a cost, or a bound above zero."""
    return bool(found.cost.at_least_usd)


def group_chart(place: int, group: PeerCosts, common: Sequence[str]) -> Chart:
    """One group, with what is to be said of it alone."""
    own = [note for note in group.notes if note not in common]
    methods = [each for each in group.methods if priced(each)]
    return Chart(
        id=f"method-costs-{place}-chart",
        kind="cost",
        title=f"Cost per failure by method: {name_of(group.peers)}",
        caption=(
            "USD per failure over all campaigns of a method, log scale, with the 95 % interval of "
            "its failure rate alone: the time billed is taken as it was; "
            "an arrow is the lower bound of a method without failures. "
            f"{' '.join([alike(group.peers), *own])}"
        ),
        data={"campaigns": [point(each) for each in methods]},
        columns=(
            *("Method", *cost_marks.COLUMNS, "Failures", "Episodes", "Rate"),
            *("Spent [USD]", "Campaigns"),
        ),
        rows=tuple(map(row, methods)),
    )


def name_of(peers: Peers) -> str:
    """Who is tested, and where."""
    return f"{peers.planner} in {peers.scenario}"


def alike(peers: Peers) -> str:
    """What else the campaigns have in common."""
    given = {
        "planner": peers.planner_settings,
        "scenario": peers.scenario_parameters,
    }
    settings = [words(name, settings) for name, settings in given.items() if settings]
    return f"In common: {', '.join([f'simulator {peers.simulator}', *settings])}."


def words(part: str, settings: Settings) -> str:
    """Settings in words."""
    told = {name: msgspec.json.encode(value).decode() for name, value in settings.items()}
    return ", ".join(f"{part}’s {name} = {value}" for name, value in told.items())


def point(found: MethodCost) -> dict[str, object]:
    """A method's mark; it leads to its newest campaign."""
    return cost_marks.mark(
        found.cost,
        id=found.newest,
        label=found.method,
        name=found.method,
        method=found.method,
        failures=found.failures,
        completed=found.completed,
    )


def row(found: MethodCost) -> tuple[str, ...]:
    """The same as text."""
    return (
        found.method,
        *cost_marks.cells(found.cost),
        formats.integer(found.failures),
        formats.integer(found.completed),
        rate_of(found.failure_rate),
        formats.number(found.cost.total_usd),
        formats.integer(found.campaigns),
    )


def rate_of(rate: Rate | None) -> str:
    """The pooled failure rate."""
    if rate is None:
        return formats.NONE
    if not rate.k:
        return f"≤ {formats.percent(rate.interval.high)}"
    return f"{formats.percent(rate.value)} ({formats.rate_interval(rate)})"
