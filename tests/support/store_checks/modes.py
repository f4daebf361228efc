"""Checks of failure modes: their names, the failures that belong to them, and filters for them."""

from msgspec.structs import replace

from eigenfail.filters import SortOrder, parse_filter
from eigenfail.testing.examples import CRASH, analysis_result, collision
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, Mode
from eigenfail.values.campaign import Campaign
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

WORDS = ("Mode 1: It brakes late. Then it does not.", "Mode 2: It steers, " + "far " * 40)


def crashed(store: Store, episodes: int = 4) -> Campaign:
    """A campaign whose episodes collide, the later the worse."""
    campaign = running(store)
    crashes = (
        collision(index, measures=replace(CRASH, severity=10.0 + index))
        for index in range(episodes)
    )
    deliver(store, campaign, *crashes)
    return campaign


def analysed(store: Store, campaign: Campaign, result: AnalysisResult) -> int:
    """The id of an analysis of a campaign that is done."""
    analysis = store.analyses.create(campaign.id, AnalysisSettings()).id
    store.analyses.finish(analysis, result)
    return analysis


def pooled(store: Store) -> tuple[Campaign, Campaign, int]:
    """Two campaigns, and an analysis of both; its second mode has failures of either."""
    one, other = crashed(store, 2), crashed(store, 2)
    deliver(store, other, collision(2, measures=replace(CRASH, severity=None)))
    result = replace(
        analysis_result(),
        episodes=(0, 1, 1, 2),
        campaigns=(one.id, one.id, other.id, other.id),
        labels=(0, 1, 1, 1),
    )
    return one, other, analysed(store, one, result)


def names_modes_by_their_words(store: Store) -> None:
    """Until somebody names it, a mode has the beginning of its description for a name."""
    campaign = crashed(store)
    waiting = store.analyses.create(campaign.id, AnalysisSettings()).id
    equal(store.analyses.modes(waiting), (), "Modes of an analysis that is not done")
    analysis = analysed(store, campaign, replace(analysis_result(), words=WORDS))
    first, second = store.analyses.modes(analysis)
    equal(first, Mode(analysis, 1, 2, "It brakes late"), "The first mode")
    equal(second.name, "It steers", "A long name ends with a phrase")
    bare = analysed(store, campaign, analysis_result())
    equal([mode.name for mode in store.analyses.modes(bare)], ["Mode 1", "Mode 2"], "Without words")


def keeps_the_names_of_modes(store: Store) -> None:
    """A name stays until it is changed again, and belongs to one mode of one analysis."""
    campaign = crashed(store)
    one, other = (analysed(store, campaign, analysis_result()) for _ in range(2))
    renamed = store.analyses.rename_mode(one, 2, "late braking")
    equal(renamed, Mode(one, 2, 2, "late braking"), "The renamed mode")
    equal(store.analyses.mode(one, 2), renamed, "The same mode, asked for")
    equal(store.analyses.mode(other, 2).name, "Mode 2", "That mode of another analysis")
    store.analyses.finish(one, replace(analysis_result(), words=WORDS))
    equal(store.analyses.mode(one, 2), renamed, "After a second end, which changes nothing")


def finds_episodes_by_mode(store: Store) -> None:
    """Rows have their mode in the newest analysis that is done, and filters compare it."""
    campaign = crashed(store)
    rows = store.episodes.page(campaign.id, 10).items
    equal([row.mode for row in rows], [None] * 4, "Modes before an analysis")
    equal(store.analyses.find_newest(campaign.id), None, "The newest analysis before the first")
    first = analysed(store, campaign, analysis_result())
    rows = store.episodes.page(campaign.id, 10).items
    equal([row.mode for row in rows], [1, 2, 1, 2], "Modes of the first analysis")
    newest = analysed(store, campaign, replace(analysis_result(2), labels=(1, 1)))
    store.analyses.create(campaign.id, AnalysisSettings())
    analysed(store, crashed(store), analysis_result())
    equal(store.analyses.find_newest(campaign.id), newest, "The newest analysis that is done")
    rows = store.episodes.page(campaign.id, 10).items
    equal([row.mode for row in rows], [2, 2, None, None], "Modes of the newest analysis")
    where = parse_filter("mode = 2 and severity > 10.5")
    found = store.episodes.page(campaign.id, 10, where=where).items
    equal([row.index for row in found], [1], "Episodes of mode 2")
    both = store.analyses.find_modes(campaign.id, 0)
    equal([(mode.analysis, mode.number) for mode in both], [(newest, 2), (first, 1)], "Of one")
    left_out = [mode.analysis for mode in store.analyses.find_modes(campaign.id, 2)]
    equal(left_out, [first], "Analyses that have an episode which the newest left out")
    equal(store.analyses.find_modes(campaign.id, 9), (), "Modes of an episode without a result")


def sorts_the_failures_of_a_mode(store: Store) -> None:
    """They may be of several campaigns; those without a value come last in both directions."""
    one, other, analysis = pooled(store)
    worst = SortOrder("severity", descending=True)
    rows = store.episodes.list_mode_failures(analysis, 2, worst, 10)
    places = [(row.campaign, row.index) for row in rows]
    equal(places, [(one.id, 1), (other.id, 1), (other.id, 2)], "The worst first")
    mildest = store.episodes.list_mode_failures(analysis, 2, SortOrder("severity"), 2)
    equal([row.campaign for row in mildest], [one.id, other.id], "The mildest first, two of them")
    equal(store.episodes.list_mode_failures(analysis, 3, worst, 10), [], "Failures of no mode")
    equal([row.mode for row in rows], [2, 2, 2], "Modes of campaigns that were analysed together")
