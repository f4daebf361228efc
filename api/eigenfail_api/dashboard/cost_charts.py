"""Charts of cost per failure, by campaign, method, and spent amount."""

from collections.abc import Mapping, Sequence

from msgspec.json import encode

from eigenfail.methods import traits_of
from eigenfail.presentation import figures
from eigenfail.presentation.tables import format_cell, read_number, read_text, tabulate
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.comparison import MethodCost, PeerCosts, Peers
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.estimates import Cost
from eigenfail.values.summary import Summary
from eigenfail.values.variation import in_words
from eigenfail_api.dashboard.charts import Chart


def mark(price: Cost, **whose: object) -> dict[str, object]:
    """Return the mark of a cost in a chart [USD], with the names of its owner."""
    bounds = price.interval_usd
    # A logarithmic axis cannot show zero: an unknown value stays null.
    return {
        **whose,
        "value": price.per_failure_usd,
        "low": bounds.low if bounds else None,
        "high": bounds.high if bounds else None,
        "at_least": price.at_least_usd,
    }


def has_price(price: Cost) -> bool:
    """Return whether there is a cost per failure, or a lower bound above zero."""
    return bool(price.per_failure_usd or price.at_least_usd)


def _format_bounds(each: Summary | MethodCost) -> str:
    cell = format_cell(each.cost)
    return cell.interval or " ".join(cell.basis)


PRICE = (
    read_text("USD per failure", lambda each: format_cell(each.cost).value),
    read_text("95 % interval", _format_bounds),
)


MOST_BARS = 25
REPLAY = "replay"


def make_cost_chart(summaries: Sequence[Summary]) -> Chart | None:
    """Return the chart of the newest campaigns' cost per failure, or its lower bound above zero."""
    # Failures that are repeated would seem cheap.
    found = [summary for summary in summaries if traits_of(summary.method).finds_new]
    priced = [summary for summary in found if has_price(summary.cost)]
    if not priced:
        return None
    shown = priced[:MOST_BARS]
    return Chart(
        id="cost-chart",
        kind="cost",
        title="Cost per failure",
        caption=(
            "USD per failure, log scale. Campaigns that draw noise from p(x) have the 95 % "
            "interval that their failure rate gives; a search has none, since another seed may "
            "cost another amount. An arrow is the lower bound of a campaign without failures. "
            "Replays, shrunk failures and evaluated policies find nothing new and are left out."
        ),
        data={
            "campaigns": [
                mark(
                    each.cost,
                    id=each.campaign,
                    name=each.name,
                    method=each.method,
                    failures=each.counts.failures,
                    completed=each.counts.completed,
                )
                for each in shown
            ]
        },
        table=tabulate(
            "",
            shown,
            read_text("Campaign", lambda each: f"{each.campaign}: {each.name}"),
            read_text("Method", "method"),
            *PRICE,
            read_number("Failures", "counts.failures"),
            read_number("Episodes", "counts.completed"),
        ),
    )


MOST_GROUPS = 3


def make_method_costs(groups: Sequence[PeerCosts]) -> tuple[tuple[Chart, ...], tuple[str, ...]]:
    """Return the charts of the newest groups with episodes and cost, and notes on all of them."""
    priced = [group for group in groups if any(has_price(each.cost) for each in group.methods)]
    shown = priced[:MOST_GROUPS]
    notes = dict.fromkeys(note for group in shown for note in group.notes)
    # Notes on all charts stand once below them, others in their captions.
    common = [note for note in notes if all(note in group.notes for group in shown)]
    charts = tuple(group_chart(place, group, common) for place, group in enumerate(shown))
    return charts, (*common, *describe_omitted_groups(len(priced) - len(shown)))


def describe_omitted_groups(count: int) -> tuple[str, ...]:
    """Return the note that further groups are left out."""
    groups = figures.count_noun(count, "older group")
    return (f"{groups} of campaigns not shown; see /api/v1/costs.",) if count > 0 else ()


def group_chart(place: int, group: PeerCosts, common: Sequence[str]) -> Chart:
    """Return the chart of one group, with the notes on that group."""
    own = [note for note in group.notes if note not in common]
    methods = [each for each in group.methods if has_price(each.cost)]
    return Chart(
        id=f"method-costs-{place}-chart",
        kind="cost",
        title=f"Cost per failure by method: {group.peers.planner} in {group.peers.scenario}",
        caption=(
            "USD per failure over all campaigns of a method, log scale. A method that draws noise "
            "from p(x) has the 95 % interval that its failure rate gives; a search has one across "
            "seeds if its campaigns differ in their seeds alone, otherwise none; "
            "an arrow is the lower bound of a method without failures. "
            f"{' '.join([describe_shared_settings(group.peers), *own])}"
        ),
        data={
            "campaigns": [
                # A point leads to the newest campaign of its method.
                mark(
                    each.cost,
                    id=each.newest,
                    label=each.method,
                    name=each.method,
                    method=each.method,
                    failures=each.failures,
                    completed=each.completed,
                )
                for each in methods
            ]
        },
        table=tabulate(
            "",
            methods,
            read_text("Method", "method"),
            *PRICE,
            read_number("Failures", "failures"),
            read_number("Episodes", "completed"),
            read_number("Rate", "failure_rate"),
            read_number("Spent [USD]", "cost.total_usd"),
            read_number("Campaigns", "campaigns"),
            read_number("Seeds of the interval", lambda each: each.seeds or None),
        ),
    )


def describe_shared_settings(peers: Peers) -> str:
    """Return the remaining settings that the campaigns have in common, as a sentence."""
    given = {
        "planner": peers.planner_settings,
        "scenario": peers.scenario_parameters,
    }
    settings = [describe_settings(name, settings) for name, settings in given.items() if settings]
    # Only what differs from the default model is worth a place in a caption.
    usual = DisturbanceModel().in_words()
    settings += [
        f"{name} of the noise: {words}"
        for name, words in peers.disturbance.in_words().items()
        if words != usual.get(name)
    ]
    named = peers.requirements or ()
    settings += [f"requirement {each.label}: {each.in_words()}" for each in named]
    return f"In common: {', '.join([f'simulator {peers.simulator}', *settings])}."


def describe_settings(part: str, settings: Settings) -> str:
    """Return settings as text."""
    values = {
        name: words if isinstance(settings[name], Mapping) else encode(settings[name]).decode()
        for name, words in in_words(settings).items()
    }
    return ", ".join(f"{part}’s {name} = {value}" for name, value in values.items())
