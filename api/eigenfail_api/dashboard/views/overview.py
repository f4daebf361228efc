"""All campaigns at a glance."""

from collections.abc import Sequence
from urllib.parse import urlencode

import msgspec

from eigenfail.values import Campaign, CampaignState, Event, Page, Summary
from eigenfail.values.campaign_filter import CampaignFilter
from eigenfail.values.pool import PeerCosts
from eigenfail.values.worker import Presence, WorkerShare
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.campaign_costs import REPLAY, cost_chart
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.crew import crew_tiles
from eigenfail_api.dashboard.views.method_costs import MethodCosts, method_costs
from eigenfail_api.dashboard.views.states import WORKING
from eigenfail_api.dashboard.views.summaries import Figure, Standing, standing


class Wanted(msgspec.Struct, frozen=True):
    """Which campaigns are asked for; None where any will do, replays aside.

    Attributes:
        method: None leaves out replays, which find nothing new.
    """

    state: CampaignState | None = None
    method: str | None = None
    search: str | None = None
    before: int | None = None

    def address(self, **changes: int | None) -> str:
        """The address of this page, or of one like it."""
        given = msgspec.structs.asdict(self) | changes
        query = {name: value for name, value in given.items() if value is not None}
        return f"/?{urlencode(query)}" if query else "/"

    @property
    def where(self) -> CampaignFilter:
        """The same in the words of the store."""
        return CampaignFilter(self.method, self.search, None if self.method else REPLAY)

    @property
    def is_filtered(self) -> bool:
        """Whether not all campaigns are wanted."""
        return (self.state, self.method, self.search) != (None, None, None)


class Overview(msgspec.Struct, frozen=True, kw_only=True):
    """The first page.

    Attributes:
        wanted: what was asked for, and the cursor of this page.
        address: of this page.
        newest: the address of the first page of these campaigns; None on it.
        older: the address of the next one, if there is one.
        methods: those that some campaign has.
        any_method: what is listed where no method is chosen.
        replays: words and address of the replays that are not listed; None if there are none.
        panel: cost per failure by method.
        wants_workers: whether there is work and nobody to do it.
        stranded: what was said of each campaign that no connected worker can run.
        latest: the newest event when the page was made, so that the feed goes on behind it.
    """

    wanted: Wanted
    address: str
    newest: str | None
    older: str | None
    states: tuple[str, ...] = tuple(CampaignState)
    methods: tuple[str, ...]
    any_method: str
    replays: tuple[str, str] | None
    lines: tuple[Standing, ...]
    tiles: tuple[tuple[str, Figure], ...]
    panel: MethodCosts
    costs: Chart | None
    is_open: bool
    wants_workers: bool
    stranded: tuple[Event, ...]
    latest: int


class Known(msgspec.Struct, frozen=True, kw_only=True):
    """What the store knows.

    Attributes:
        page: some campaigns, newest first.
        summaries: of them, in the same order.
        groups: costs by method, of all campaigns.
        methods: those that some campaign has.
        replays: how many campaigns replay what others found.
        here: the workers that are connected now.
        lately: who brought results in the last `within_s` seconds.
        stranded: what was said of each campaign that no connected worker can run.
        latest: the id of the newest event.
    """

    page: Page[Campaign]
    summaries: Sequence[Summary]
    groups: Sequence[PeerCosts]
    methods: Sequence[str]
    replays: int
    here: Sequence[Presence]
    lately: Sequence[WorkerShare]
    within_s: int
    stranded: tuple[Event, ...]
    latest: int


def overview(known: Known, wanted: Wanted) -> Overview:
    """The page."""
    lines = tuple(map(standing, known.page.items, known.summaries))
    return Overview(
        wanted=wanted,
        address=wanted.address(),
        newest=wanted.address(before=None) if wanted.before else None,
        older=wanted.address(before=known.page.next) if known.page.next else None,
        methods=tuple(known.methods),
        any_method=f"any but {REPLAY}" if known.replays else "any",
        replays=folded(known.replays, wanted),
        lines=lines,
        tiles=(
            *tiles(known.page.items, known.summaries),
            *crew_tiles(known.here, known.lately, known.within_s),
        ),
        panel=method_costs(known.groups),
        costs=cost_chart(known.summaries),
        is_open=any(line.is_open for line in lines),
        wants_workers=not known.here and any(c.state in WORKING for c in known.page.items),
        stranded=known.stranded,
        latest=known.latest,
    )


def folded(count: int, wanted: Wanted) -> tuple[str, str] | None:
    """How many replays are not listed, and where those are that are like what is wanted."""
    if wanted.method or not count:
        return None
    among = "those like that among " if wanted.is_filtered else ""
    words = f"{among}{formats.counted(count, 'replay')}"
    return words, msgspec.structs.replace(wanted, method=REPLAY, before=None).address()


def tiles(
    campaigns: Sequence[Campaign], summaries: Sequence[Summary]
) -> tuple[tuple[str, Figure], ...]:
    """Sums over the campaigns of the page."""
    running = sum(campaign.state == "running" for campaign in campaigns)
    completed = sum(campaign.counts.completed for campaign in campaigns)
    failures = sum(campaign.counts.failures for campaign in campaigns)
    spent = sum(summary.cost.total_usd for summary in summaries)
    return (
        ("Campaigns", Figure(formats.integer(len(campaigns)), (f"{running} running",))),
        ("Episodes", Figure(formats.integer(completed), ("completed",))),
        ("Failures", Figure(formats.integer(failures), ("collisions",))),
        ("Spent", Figure(f"{formats.number(spent)} USD", ("instance-hours × price",))),
    )
