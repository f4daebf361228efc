"""Tiles, badges and pagers, which several pages have."""

from typing import NamedTuple

import msgspec

from eigenfail.presentation.figures import (
    UNKNOWN,
    format_count,
    format_duration,
    format_number,
    format_usd,
)
from eigenfail.presentation.tables import format_cell, format_cost
from eigenfail.values import (
    FINAL_STATES,
    AnalysisState,
    Campaign,
    CampaignState,
    Counts,
    Estimate,
    Outcome,
    Summary,
)
from eigenfail.values.campaign import state_word
from eigenfail.values.episode import ERRORED

S = CampaignState

WORKING = frozenset({S.QUEUED, S.RUNNING})
"""In which a campaign needs workers."""


class Badge(msgspec.Struct, frozen=True):
    """A word, a sign before it, and the tone of its colour."""

    word: str
    sign: str
    tone: str


CAMPAIGN_BADGES = {
    S.QUEUED: Badge("queued", "○", "waiting"),
    S.RUNNING: Badge("running", "▶", "active"),
    S.PAUSING: Badge("pausing", "‖", "waiting"),
    S.PAUSED: Badge("paused", "‖", "waiting"),
    S.CANCELLING: Badge("cancelling", "×", "waiting"),
    S.CANCELLED: Badge("cancelled", "×", "ended"),
    S.DONE: Badge("done", "✓", "good"),
    S.DEAD: Badge("dead", "!", "bad"),
}
ERRORED_BADGE = Badge(ERRORED, "!", "bad")


def campaign_badge(state: CampaignState, counts: Counts) -> Badge:
    """Return the badge of a campaign: red, and not green, if all of its episodes errored."""
    is_errored = state_word(state, counts) == ERRORED
    return ERRORED_BADGE if is_errored else CAMPAIGN_BADGES[state]


ANALYSIS_BADGES = {
    AnalysisState.QUEUED: Badge("queued", "○", "waiting"),
    AnalysisState.RUNNING: Badge("running", "▶", "active"),
    AnalysisState.DONE: Badge("done", "✓", "good"),
    AnalysisState.FAILED: Badge("failed", "!", "bad"),
}
OUTCOME_BADGES = {
    Outcome.COLLISION: Badge("collision", "◆", "bad"),
    Outcome.SAFE: Badge("safe", "○", "good"),
    Outcome.FAILED: Badge(ERRORED, "!", "waiting"),
}


NOTHING_YET = ("no episode completed",)


class Tile(msgspec.Struct, frozen=True):
    """A figure, and what it rests on.

    Attributes:
        value: the figure with its unit.
        notes: what it rests on, each a line below it.
        remark: a sentence on how to read it; empty if there is nothing to say.
        mark: what stands for the remark in a table, in a few words; empty if the remark does.
        term: label of the definition beside the mark.
    """

    value: str
    notes: tuple[str, ...] = ()
    remark: str = ""
    mark: str = ""
    term: str = ""


class StandingView(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign as it stands, in text.

    Attributes:
        is_open: whether it may still change by itself or by what a user asks.
        ended: episodes with a result; of `planned`, of which `wanted` are not left unrun.
        errored: how many episodes errored, and why, in sentences; empty if none did.
        remaining: how long it will take still, if that can be said, or what was left unrun.
    """

    id: int
    name: str
    method: str
    planner: str
    scenario: str
    simulator: str
    badge: Badge
    is_open: bool
    because: str
    ended: int
    planned: int
    wanted: int
    remaining: str
    errored: str
    failures: Tile
    probability: Tile | None
    cost: Tile
    total: Tile
    likelihood: Tile
    severity: Tile
    speed: Tile


def standing(campaign: Campaign, summary: Summary) -> StandingView:
    """A campaign and its summary as text."""
    spec, counts = campaign.spec, campaign.counts
    return StandingView(
        id=campaign.id,
        name=spec.name,
        method=spec.method,
        planner=spec.planner,
        scenario=spec.scenario,
        simulator=spec.simulator,
        badge=campaign_badge(campaign.state, campaign.counts),
        is_open=campaign.state not in FINAL_STATES,
        because=campaign.stopped_because,
        ended=counts.completed + counts.failed,
        planned=counts.planned,
        wanted=counts.planned - counts.cancelled,
        remaining=remaining(campaign, summary),
        errored=summary.errored.words(counts),
        failures=failures(summary),
        probability=probability(summary.estimate),
        cost=cost(summary),
        total=total(campaign, summary),
        likelihood=Tile(format_number(summary.log_probability_per_step), ("of the failures",)),
        severity=Tile(format_number(summary.mean_severity), ("of the failures",)),
        speed=Tile(
            format_number(summary.episodes_per_s), (f"in {format_duration(campaign.active_s)}",)
        ),
    )


def remaining(campaign: Campaign, summary: Summary) -> str:
    """How long the open episodes take at the pace so far, or how many were left unrun."""
    if campaign.counts.cancelled:
        return f"{format_count(campaign.counts.cancelled)} not run"
    if campaign.state != "running" or not summary.episodes_per_s:
        return ""
    return f"about {format_duration(campaign.counts.open / summary.episodes_per_s)} left"


def failures(summary: Summary) -> Tile:
    """How many, and at what rate."""
    rate = summary.failure_rate
    if rate is None:
        nothing_yet = () if summary.remark else NOTHING_YET
        return Tile(UNKNOWN, nothing_yet, summary.remark, *mark_of(summary))
    share = format_cell(rate)
    notes = (share.line,) if rate.k else (share.value, *share.basis)
    value = f"{format_count(rate.k)} of {format_count(rate.n)}"
    return Tile(value, notes, summary.remark, *mark_of(summary))


def mark_of(summary: Summary) -> tuple[str, str]:
    """Return the numbers of errored and unresolved episodes, and the label of the first kind."""
    unresolved = summary.unresolved
    counts = (
        (summary.errored.count, "errored", "Errored"),
        (unresolved.count, "unresolved", "Unresolved"),
        (unresolved.not_known, "perhaps unresolved", "Unresolved"),
    )
    found = [(f"{format_count(n)} {words}", label) for n, words, label in counts if n]
    return ", ".join(words for words, _ in found), found[0][1] if found else ""


def probability(estimate: Estimate | None) -> Tile | None:
    """Of a failure under p(x), or why it is not told; None where the method tells none."""
    if estimate is None:
        return None
    value, *notes = format_cell(estimate).lines
    return Tile(value, tuple(notes))


def cost(summary: Summary) -> Tile:
    """What a failure cost, from how many failures, and how sure that is."""
    price, counts = format_cost(summary.cost), summary.counts
    n = "n = 0 in " if not counts.failures else "n = "
    basis = (f"{n}{format_count(counts.failures or counts.completed)}",) if counts.completed else ()
    return Tile(price.value, (*basis, *price.notes))


def speed(campaign: Campaign, summary: Summary) -> Tile:
    """Episodes per second of the time that it was running."""
    lasted = format_duration(campaign.active_s)
    return Tile(format_number(summary.episodes_per_s), (f"in {lasted}",))


def total(campaign: Campaign, summary: Summary) -> Tile:
    """What all of it cost."""
    hours = format_number(summary.cost.instance_hours)
    price = format_number(campaign.spec.price_usd_per_hour)
    return Tile(f"{format_usd(summary.cost.total_usd)} USD", (f"{hours} h × {price} USD/h",))


class Pager(NamedTuple):
    """Where one is in a list.

    Attributes:
        address: of this page.
        newest: the address of the first page; None on it.
        older: the address of the next one, if there is one.
    """

    address: str
    newest: str | None
    older: str | None


def pager(address: str, before: int | None, following: int | None) -> Pager:
    """Of the page that begins below a cursor, and the cursor of the next one."""
    return Pager(
        page_of(address, before),
        page_of(address, None) if before else None,
        page_of(address, following) if following else None,
    )


def page_of(address: str, before: int | None) -> str:
    """A list, from a cursor on."""
    return f"{address}?before={before}" if before else address
