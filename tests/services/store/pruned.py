"""Campaigns to prune, and damage that no program of ours would do."""

from contextlib import closing

from sqlalchemy import text
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.operations import Retention
from eigenfail.values.records import JobKind
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import Store
from eigenfail_services.upkeep.pruning import PruneSelection

FIFTHS = Retention(keep_every=5)
EVERYTHING = PruneSelection()
COUNT = 40
LOST = COUNT - COUNT // 5 - 3
"""But for fifths, two failures and one that could not be run."""


def fill(store: Store, **changes) -> Campaign:
    campaign = running(store, **{"episodes": COUNT} | changes)
    safe = [result(index) for index in range(COUNT) if index not in (11, 12, 13)]
    crashed = [collision(index, source="prior") for index in (11, 12)]
    deliver(store, campaign, *safe, *crashed, make_errored_result(13))
    return ended(store, campaign)


def ended(store: Store, campaign: Campaign) -> Campaign:
    """As a service ends it."""
    after = store.campaigns.move(campaign.id, CampaignState.DONE)
    assert (job := store.jobs.claim("test", 60.0, JobKind.CAMPAIGN))
    assert store.jobs.finish(job)
    return after


def change(url: str, statement: str) -> None:
    with closing(Database(find_backend(url))) as database, database.writing() as connection:
        connection.execute(text(statement))
