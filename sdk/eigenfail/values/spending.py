"""What a campaign cost, what it went into, and what was found by when."""

import msgspec

from eigenfail.values.campaign import Cost
from eigenfail.values.showing import Brief, Shown, Tabular

MOST_LANDINGS = 200
"""How many points a curve of cost has at most, beside its ends."""


class Landing(msgspec.Struct, frozen=True):
    """How far a campaign had come when a result was stored.

    Attributes:
        at_ms: when that was, since 1970.
        completed: episodes until then, this one included.
        failures: collisions among them.
    """

    at_ms: int
    completed: int
    failures: int


class SpendingTotals(msgspec.Struct, frozen=True):
    """What the store knows of the time in a campaign's episodes.

    Attributes:
        completed_worker_s: sum of `wall_s` over the completed episodes.
        failed_worker_s: over those that errored.
        landings: every k-th completed episode by the time that it was stored, then by index, and
            the last one.
    """

    completed_worker_s: float = 0.0
    failed_worker_s: float = 0.0
    landings: tuple[Landing, ...] = ()


class CostPoint(msgspec.Struct, frozen=True, kw_only=True):
    """What was found by the time that so much had been spent.

    Attributes:
        usd: price per instance-hour × instance-hours until then.
        active_s: time during which the campaign had been running.
        completed: episodes.
        failures: collisions among them.
        modes: distinct modes of which a failure was among them; None where none are known.
    """

    usd: float
    active_s: float
    completed: int
    failures: int
    modes: int | None


class TimeSplit(msgspec.Struct, frozen=True, kw_only=True):
    """What the time went into for which a campaign was billed; the four parts sum to `active_s`.

    The parts are None where the hub did not measure: in campaigns of older releases.

    Attributes:
        active_s: time during which the campaign was running.
        simulation_s: at least one episode was with a worker, less `lost_s`.
        learning_s: no episode was with a worker, and the learner worked; its start included.
        waiting_s: neither: for workers, or for the database.
        lost_s: of the time in which episodes were with workers, the share whose results were
            thrown away: `lost_worker_s` ÷ (`worker_s` + `lost_worker_s`).
        worker_s: worker time in completed episodes, summed over all workers.
        lost_worker_s: worker time in episodes that errored, in second results of an
            episode, and in results that the store did not want.
        problem: why the parts are missing; empty otherwise.
    """

    active_s: float
    worker_s: float
    simulation_s: float | None = None
    learning_s: float | None = None
    waiting_s: float | None = None
    lost_s: float | None = None
    lost_worker_s: float | None = None
    problem: str = ""


class CampaignCost(Brief, Shown, Tabular, msgspec.Struct, frozen=True, kw_only=True):
    """What a campaign cost, and what that bought.

    Attributes:
        price_usd_per_hour: of one instance.
        instances: how many it occupied while it ran.
        completed: episodes.
        failures: collisions among them.
        cost: in total and per failure, with its interval or lower bound.
        analysis: the newest of this campaign that is done; None without one.
        modes: distinct modes that it has failures of; None where none are known.
        per_mode_usd: total ÷ modes; None where none are known.
        modes_in_words: how many there are and why, or why they are not known.
        curve: from nothing spent to everything, in order of time.
        time: what the time went into.
        notes: what is approximate.
    """

    campaign: int
    name: str
    method: str
    price_usd_per_hour: float
    instances: int
    completed: int
    failures: int
    cost: Cost
    analysis: int | None
    modes: int | None
    per_mode_usd: float | None
    modes_in_words: str
    curve: tuple[CostPoint, ...]
    time: TimeSplit
    notes: tuple[str, ...] = ()
