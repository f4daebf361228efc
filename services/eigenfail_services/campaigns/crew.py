"""Who works, and who did."""

from eigenfail.contracts import Store
from eigenfail.errors import NotFound
from eigenfail.values import Campaign, Event
from eigenfail.values.worker import Presence, Staffing, WorkerShare
from eigenfail_services.hub.stranded import LACKING, MET
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.refusals import no_episode

LOOKED_AT = 200
WORDS = frozenset({"workers.asked", "workers.refused", "ray.lost", "ray.back", "ray.machines"})
"""Kinds of events that tell of workers which the services start."""

OUTLOOK = frozenset({LACKING, MET, "campaign.state", "campaign.progress"})
"""Kinds of events after which a campaign goes on, or waits for another worker than there is."""

LATELY_S = 600
PRESENT_S = 15
"""Whom no hub has named for so many seconds is not there: hubs do so every few seconds."""


def workers_of(store: Store, campaign: Campaign) -> tuple[WorkerShare, ...]:
    """Who ran the episodes of a campaign; who ran most comes first."""
    return store.figures.workers(campaign.id)


def lately(store: Store, within_s: int = LATELY_S) -> tuple[WorkerShare, ...]:
    """Who brought results within some seconds, and of which campaigns; only these are counted."""
    return store.figures.workers_since(now_ms() - 1_000 * within_s)


def present(store: Store) -> tuple[Presence, ...]:
    """Who is connected to a hub now, by name, at work or not."""
    return store.roster.present(now_ms() - 1_000 * PRESENT_S)


def stranded(store: Store) -> tuple[Event, ...]:
    """What was said of each campaign that runs and that no connected worker can run."""
    return tuple(event for event in store.events.newest(OUTLOOK) if event.kind == LACKING)


def staffing(store: Store) -> Staffing:
    """How many are there, what was said last of those that are to come, and who lacks others.

    Where nobody works hardly anything else is said: few events are looked at.
    """
    workers, lacking = len(present(store)), stranded(store)
    for event in store.events.latest(LOOKED_AT):
        if event.kind in WORDS:
            return Staffing(
                workers=workers, said=event.message, said_ms=event.at_ms, stranded=lacking
            )
    return Staffing(workers=workers, stranded=lacking)


def who_ran(store: Store, campaign: int, index: int) -> Presence:
    """The worker whose result of an episode is kept, as it was there then.

    Raises:
        NotFound: no such episode, or nothing is known of its worker any more.
    """
    row = next(iter(store.episodes.page(campaign, 1, index - 1 if index else None).items), None)
    if row is None or row.index != index:
        raise no_episode(campaign, index)
    if (found := store.roster.last(row.worker, row.finished_ms)) is None:
        problem = f"Nothing is known of the worker '{row.worker}' of episode {campaign}/{index}."
        raise NotFound(problem, "Workers are written down when they connect to a hub.")
    return found
