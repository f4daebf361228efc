"""Checks of `RetentionStore`: what goes, what stays, and what is said of it."""

from accepted import accept_spec, accept_specs

from eigenfail.errors import Conflict, NoisePruned, NotFound
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.operations import Retention, Weight
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

THIRDS = Retention(keep_every=3)
WHO = "somebody"
LOST = [1, 2, 7, 8]
"""Of the ten episodes: 3 and 4 are failures, 5 is of another source, 6 and 0 and 9 are thirds."""

BYTES = 3 * 2 * 4 * 2
"""Of the noise of one, z and sigma."""


def ended(store: Store) -> Campaign:
    """A campaign with an episode of every kind, that is done."""
    campaign = running(store)
    safe = [result(index) for index in (0, 1, 2, 6, 7, 8, 9)]
    others = (collision(3), collision(4, source="prior"), result(5, source="policy"))
    deliver(store, campaign, *safe, *others)
    return store.campaigns.move(campaign.id, CampaignState.DONE)


def pruned(store: Store) -> Campaign:
    """The same, after a pruning."""
    campaign = ended(store)
    record = store.retention.prune(campaign.id, THIRDS, WHO)
    expect(record is not None, "Nothing was pruned.")
    return campaign


def weighs_what_goes(store: Store) -> None:
    """Safe episodes of the source whose index is no multiple; nothing changes."""
    campaign = ended(store)
    weight = store.retention.weigh(campaign.id, THIRDS)
    equal(weight, Weight(len(LOST), 0, len(LOST) * BYTES), "What goes")
    equal(store.retention.weigh(campaign.id, Retention(3, "policy")), Weight(1, 0, BYTES), "Policy")
    equal(store.retention.of(campaign.id), (), "Records of nothing")
    equal(len(store.episodes.finished(campaign.id, range(10))), 10, "Noise that is there")


def records_what_is_gone(store: Store) -> None:
    """Which rule, how far, who, how much; and an event."""
    campaign = pruned(store)
    (record,) = store.retention.of(campaign.id)
    equal((record.campaign, record.retention, record.who), (campaign.id, THIRDS, WHO), "The record")
    equal(record.through, LOST[-1], "How far it has come")
    equal(record.weight, Weight(len(LOST), 0, len(LOST) * BYTES), "What is gone")
    (event,) = store.events.latest(1, campaign.id)
    equal(event.kind, "campaign.pruned", "The event")
    expect(WHO in event.message, f"The event does not say who: {event.message}")


def says_so_where_noise_is_wanted(store: Store) -> None:
    """Never fewer than were asked for, never other noise: NoisePruned, with the way out."""
    campaign = pruned(store)
    with expect_error(NoisePruned, "Noise that is gone was given."):
        store.episodes.get(campaign.id, 1)
    with expect_error(NoisePruned, "Episodes were left out."):
        store.episodes.finished(campaign.id, [0, 1])
    with expect_error(NotFound, "An episode of nothing was given."):
        store.episodes.get(campaign.id, 99)
    try:
        store.episodes.get(campaign.id, 1)
    except NoisePruned as error:
        expect(f"episode replay {campaign.id}/1" in error.remedy, f"No way out: {error.remedy}")


def prunes_once(store: Store) -> None:
    """A second time there is nothing; a stricter rule takes what is left."""
    campaign = pruned(store)
    (record,) = store.retention.of(campaign.id)
    equal(store.retention.prune(campaign.id, THIRDS, WHO, record.id), None, "The rest of it")
    equal(store.retention.prune(campaign.id, THIRDS, WHO), None, "A second time")
    equal(store.retention.weigh(campaign.id, THIRDS), Weight(), "What is left to go")
    equal(len(store.retention.of(campaign.id)), 1, "Records")
    stricter = store.retention.prune(campaign.id, Retention(keep_every=9), WHO)
    equal(stricter and stricter.weight.episodes, 1, "What a stricter rule takes")
    equal(len(store.retention.of(campaign.id)), 2, "Records of both")
    rows = store.episodes.page(campaign.id, 20).items
    lost = [row.index for row in rows if row.noise_pruned_ms is not None]
    equal(lost, sorted([*LOST, 6]), "Those without noise")


def takes_scenes_with_the_noise(store: Store) -> None:
    """The row says that there is none any more."""
    campaign = running(store)
    scene = collision(1).scene
    deliver(store, campaign, result(1, scene=scene), result(3, scene=scene), make_errored_result(2))
    store.campaigns.move(campaign.id, CampaignState.CANCELLING)
    store.campaigns.move(campaign.id, CampaignState.CANCELLED)
    record = store.retention.prune(campaign.id, THIRDS, WHO)
    equal(record and (record.weight.episodes, record.weight.scenes), (1, 1), "What is gone")
    rows = store.episodes.page(campaign.id, 20).items
    equal([row.has_scene for row in rows], [False, False, True], "Scenes")


def leaves_alone_what_others_need(store: Store) -> None:
    """From the moment at which it is named until that one has ended, in the midst of it, too."""
    campaign = ended(store)
    settings = {"campaign": campaign.id, "episodes": [1]}
    replay = store.campaigns.create(accept_spec(spec(method="replay", settings=settings)))
    equal(store.retention.in_use(), frozenset({campaign.id}), "What is in use")
    with expect_error(Conflict, "Noise went that a queued replay names."):
        store.retention.prune(campaign.id, THIRDS, WHO)
    store.campaigns.move(replay.id, CampaignState.CANCELLED)
    analysis = store.analyses.create(campaign.id, AnalysisSettings())
    with expect_error(Conflict, "Noise went that a queued analysis reads."):
        store.retention.prune(campaign.id, THIRDS, WHO)
    store.analyses.fail(analysis.id, "It is not needed.")
    equal(store.retention.in_use(), frozenset(), "What is in use at last")
    expect(store.retention.prune(campaign.id, THIRDS, WHO) is not None, "Nothing was pruned.")
    with expect_error(NoisePruned, "A replay of noise that is gone was queued."):
        store.campaigns.create(accept_spec(spec(method="replay", settings=settings)))
    try:
        store.campaigns.create_many(accept_specs([spec(method="replay", settings=settings)]))
    except NoisePruned as error:
        expect(f"episode {campaign.id}/1" in error.problem, f"Another episode: {error.problem}")
    else:
        raise AssertionError("A suite with one was queued.")
    store.campaigns.create(
        accept_spec(spec(method="replay", settings=settings | {"episodes": [0, 3]}))
    )


def leaves_alone_what_has_not_ended(store: Store) -> None:
    """Its learner may need all noise again."""
    campaign = running(store)
    deliver(store, campaign, result(1))
    with expect_error(Conflict, "A running campaign was pruned."):
        store.retention.prune(campaign.id, THIRDS, WHO)
    equal(store.retention.of(campaign.id), (), "Records")
