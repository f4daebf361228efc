"""Checks of the list of failures of all campaigns, beside sorting all of them in memory."""

from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.testing import expect_error
from eigenfail.testing.examples import collision, result
from eigenfail.values.campaign import CampaignFilter, CampaignState
from eigenfail.values.campaign_spec import MAX_EPISODES
from eigenfail.values.episode import Outcome
from eigenfail.values.failures import FailureFilter
from eigenfail.values.measures import Measures
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

ANY = FailureFilter(CampaignFilter())
EPISODES = 6
Place = tuple[float, int, int]


def fill(store: Store) -> list[Place]:
    """Campaigns whose failures are equally severe in part; severity, campaign and index of all."""
    planners = ("rulebook", "idm", "rulebook", "idm")
    places = []
    for number, planner in enumerate(planners):
        campaign = running(store, planner=planner, planner_version=f"v{number}", project="x")
        crashes = [
            collision(index, measures=Measures(0.0, severity=float((7 * index + number) % 5)))
            for index in range(EPISODES)
        ]
        # Neither a violation nor a collision that no requirement forbids is in the list.
        others = [
            result(EPISODES, Outcome.VIOLATION, measures=Measures(-1.0)),
            result(EPISODES + 1, measures=Measures(0.0, severity=99.0)),
        ]
        deliver(store, campaign, *crashes, *others)
        store.campaigns.move(campaign.id, CampaignState.DONE)
        places += [(each.measures.severity or 0.0, campaign.id, each.index) for each in crashes]
    return places


def walk(store: Store, where: FailureFilter, limit: int, descending: bool = True) -> list[Place]:
    """All failures of a list, page by page."""
    found: list[Place] = []
    after = None
    while True:
        page = store.failures.page(where, limit, after, most_severe_first=descending)
        found += [(row.severity or 0.0, row.campaign, row.index) for row in page.items]
        after = page.next
        if after is None:
            return found


def sorts_failures_of_all_campaigns(store: Store) -> None:
    """In both orders, on pages of any size, without gap or overlap."""
    equal(walk(store, ANY, 5), [], "Failures of an empty store")
    places = fill(store)
    for limit in (1, 2, 7, 200):
        for descending in (True, False):
            wanted = sorted(places, reverse=descending)
            equal(walk(store, ANY, limit, descending), wanted, f"Pages of {limit}")
    for stranger in (0, MAX_EPISODES + EPISODES, 2**63 - 1):
        with expect_error(InvalidValue, f"{stranger} is a place."):
            store.failures.page(ANY, 5, stranger)


def filters_failures_by_campaign(store: Store) -> None:
    """Project, planner, version, method and archive are those of the campaign."""
    places = fill(store)
    planners = {1: "rulebook", 2: "idm", 3: "rulebook", 4: "idm"}
    equal([*planners], sorted({campaign for _, campaign, _ in places}), "The campaigns")
    store.campaigns.archive(1)
    for where, campaigns in (
        (replace(ANY, planner="idm"), {2, 4}),
        (replace(ANY, campaign=CampaignFilter(planner_version="v2")), {3}),
        (replace(ANY, campaign=CampaignFilter(project="y")), set[int]()),
        (replace(ANY, campaign=CampaignFilter(archived=False)), {2, 3, 4}),
        (replace(ANY, campaign=CampaignFilter(method="monte_carlo")), {1, 2, 3, 4}),
        (replace(ANY, besides=("replay", "monte_carlo")), set[int]()),
    ):
        wanted = sorted((each for each in places if each[1] in campaigns), reverse=True)
        equal(walk(store, where, 4), wanted, f"{where}")
    rows = store.failures.page(ANY, 200).items
    equal(sorted(store.failures.read_campaigns(rows)), [*planners], "The campaigns of the rows")
    (row,) = store.failures.page(replace(ANY, planner="idm"), 1).items
    listed = store.episodes.page(row.campaign, 1, row.index - 1).items
    equal(row, listed[0], "The row beside that of the list of its campaign")
