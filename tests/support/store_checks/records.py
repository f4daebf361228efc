"""Checks of `EventLog`, `CheckpointStore` and `AnalysisStore`."""

from eigenfail.testing import expect
from eigenfail.testing.examples import analysis_result
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail.values.estimates import Estimate, Interval
from eigenfail.values.records import JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import alike, equal, running


def numbers_events(store: Store) -> None:
    """Ids rise by one, and the log is read from any of them on."""
    equal(store.events.last(), 0, "The last id of an empty log")
    equal(store.events.after(0, 10), [], "An empty log")
    logged = [store.events.append("campaign.progress", f"{n} done", n % 2) for n in range(4)]
    equal([event.id for event in logged], [1, 2, 3, 4], "Ids")
    equal(store.events.last(), 4, "The last id")
    equal(store.events.after(0, 10), logged, "The whole log")
    equal(store.events.after(1, 2), logged[1:3], "Two events behind the first")
    equal(store.events.after(4, 10), [], "What comes behind the last")
    equal(store.events.after(0, 10, campaign=1), logged[1::2], "The events of campaign 1")
    equal(store.events.after(2**70, 10), [], "What comes behind 2**70")


def tells_the_newest_event_of_what_runs(store: Store) -> None:
    """One event of some kinds for each campaign that is running, whatever else is logged."""
    one, other, ended = running(store), running(store), running(store)
    kinds = {"workers.lacking", "workers.met"}
    equal(store.events.newest(kinds), [], "The newest events before the first")
    store.events.append("workers.met", "earlier", one.id)
    for campaign in (ended, other, one):
        store.events.append("workers.lacking", f"of {campaign.id}", campaign.id)
    store.events.append("campaign.progress", "of another kind", one.id)
    store.events.append("workers.met", "of no campaign")
    store.campaigns.move(ended.id, CampaignState.DONE)
    told = [(event.campaign, event.message) for event in store.events.newest(kinds)]
    equal(told, [(each.id, f"of {each.id}") for each in (one, other)], "The newest events")


def logs_without_a_campaign(store: Store) -> None:
    """An event may be of no campaign, and of any text."""
    event = store.events.append("service.started", "odd \x00 text")
    equal(event.campaign, None, "The campaign of an event of none")
    equal(len(store.events.after(0, 10)), 1, "Events")
    equal(store.events.after(0, 10, campaign=7), [], "Events of another campaign")


def keeps_the_last_checkpoint(store: Store) -> None:
    """The newest checkpoint is the one to go on from; campaigns do not share."""
    one, other = running(store), running(store)
    equal(store.checkpoints.load(one.id), None, "A checkpoint before the first")
    equal(store.checkpoints.recover(one.id), None, "A checkpoint to go on from, before the first")
    for state in (b"", b"later", bytes(range(256)) * 4_096):
        store.checkpoints.save(one.id, state)
        expect(store.checkpoints.load(one.id) == state, "A checkpoint came back changed.")
        expect(store.checkpoints.recover(one.id) == state, "One was recovered changed.")
    equal(store.checkpoints.load(other.id), None, "Another campaign's checkpoint")


def keeps_the_last_estimate(store: Store) -> None:
    """A campaign carries what its learner told with the last checkpoint; campaigns do not share."""
    one, other = running(store), running(store)
    equal(store.campaigns.get(one.id).estimate, None, "An estimate before the first")
    refused = Estimate(by="importance sampling", episodes=7, problem="Too few of 7 · ½ count.")
    told = Estimate(
        by="subset simulation",
        episodes=9_100,
        probability=3.65e-6,
        cv=0.25,
        interval=Interval(2.2e-6, 5.9e-6),
        effective=16.5,
        note="It knows nothing of what no sample came near.",
    )
    for estimate in (refused, told):
        store.checkpoints.save(one.id, b"state", estimate)
        equal(store.campaigns.get(one.id).estimate, estimate, "The estimate")
    equal([campaign.estimate for campaign in store.campaigns.page(2).items], [None, told], "A page")
    store.campaigns.move(one.id, CampaignState.DONE)
    equal(store.campaigns.get(one.id).estimate, told, "The estimate of an ended campaign")
    equal(store.campaigns.get(other.id).estimate, None, "Another campaign's estimate")
    store.checkpoints.save(one.id, b"state")
    equal(store.campaigns.get(one.id).estimate, None, "The estimate after none was told")


def creates_queued_analyses(store: Store) -> None:
    """A new analysis waits, with a job and an event."""
    campaign = running(store)
    settings = AnalysisSettings("collision", 2, 5)
    analysis = store.analyses.create(campaign.id, settings)
    found = store.analyses.get(analysis.id)
    equal((found.campaign, found.settings), (campaign.id, settings), "What was asked for")
    equal((found.state, found.result), (AnalysisState.QUEUED, None), "A new analysis")
    equal((found.problem, store.analyses.replays(analysis.id)), ("", ()), "A new analysis")
    equal(store.jobs.waiting(JobKind.ANALYSIS), 1, "Jobs for one analysis")
    event = store.events.after(0, 10)[-1]
    equal((event.kind, event.campaign), ("analysis.state", campaign.id), "The event")


def finishes_analyses(store: Store) -> None:
    """What was found comes back bit for bit, and everybody hears of it."""
    campaign = running(store)
    number = store.analyses.create(campaign.id, AnalysisSettings()).id
    store.analyses.start(number)
    equal(store.analyses.get(number).state, AnalysisState.RUNNING, "A started analysis")
    store.analyses.start(number)
    store.analyses.finish(number, analysis_result())
    found = store.analyses.get(number)
    equal(found.state, AnalysisState.DONE, "A finished analysis")
    if found.result is None:
        raise AssertionError("A finished analysis has no result.")
    same_findings(found.result, analysis_result())
    kinds = [event.kind for event in store.events.after(0, 20)]
    expect(kinds.count("analysis.state") >= 3, f"The log tells of {kinds}.")


def same_findings(found: AnalysisResult, wanted: AnalysisResult) -> None:
    """Expect the same result."""
    for name in ("episodes", "labels", "silhouette", "noise_silhouette"):
        equal(getattr(found, name), getattr(wanted, name), name)
    for name in ("explained", "components", "scores", "influence"):
        alike(getattr(found, name), getattr(wanted, name), name)
    for one, other in zip(found.modes, wanted.modes, strict=True):
        equal((one.failures, one.medoid), (other.failures, other.medoid), "A mode")
        alike(one.centre, other.centre, "A mode's centre")
        alike(one.eigenfailure, other.eigenfailure, "An eigenfailure")


def first_end_counts(store: Store) -> None:
    """Whoever ends an analysis second changes nothing."""
    campaign = running(store)
    failed, done = (store.analyses.create(campaign.id, AnalysisSettings()).id for _ in range(2))
    store.analyses.fail(failed, "There is no failure to analyse.")
    store.analyses.finish(failed, analysis_result())
    store.analyses.start(failed)
    found = store.analyses.get(failed)
    equal((found.state, found.result), (AnalysisState.FAILED, None), "A failed analysis")
    equal(found.problem, "There is no failure to analyse.", "Its problem")
    store.analyses.finish(done, analysis_result())
    store.analyses.fail(done, "Too late.")
    found = store.analyses.get(done)
    equal((found.state, found.problem), (AnalysisState.DONE, ""), "A finished analysis")


def links_replays(store: Store) -> None:
    """An analysis remembers who replays what it found, each once."""
    campaign, first, second = (running(store).id for _ in range(3))
    number, other = (store.analyses.create(campaign, AnalysisSettings()).id for _ in range(2))
    for replay in (second, first, second):
        store.analyses.link_replay(number, replay)
    equal(store.analyses.replays(number), (first, second), "The replays")
    equal(store.analyses.replays(other), (), "The replays of another analysis")


def pages_analyses(store: Store) -> None:
    """Newest first, of one campaign or of all, without what they found."""
    one, other = running(store), running(store)
    ids = [store.analyses.create(c.id, AnalysisSettings()).id for c in (one, other, one)]
    store.analyses.finish(ids[2], analysis_result())
    first = store.analyses.page(2)
    second = store.analyses.page(2, first.next)
    equal([a.id for a in (*first.items, *second.items)], ids[::-1], "Two pages")
    equal((first.next, second.next), (ids[1], None), "Their cursors")
    expect(first.items[0].result is None, "A result came along.")
    equal(first.items[0].state, AnalysisState.DONE, "The state in a list")
    mine = store.analyses.page(10, campaign=one.id)
    equal([a.id for a in mine.items], [ids[2], ids[0]], "Analyses of one campaign")
