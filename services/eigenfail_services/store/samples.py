"""A bounded number of a campaign's episodes, evenly spread, for charts."""

from math import ceil

from sqlalchemy import Connection, func, select

from eigenfail.values import Outcome
from eigenfail.values.sample import EpisodeSample
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes


def samples(connection: Connection, campaign: int, most: int) -> tuple[EpisodeSample, ...]:
    """The completed episodes whose index is a multiple of the smallest number that is enough."""
    inside = episodes.c.campaign == campaign
    reach = connection.execute(select(func.coalesce(func.max(number), -1)).where(inside))
    every = max(1, ceil((reach.scalar_one() + 1) / most))
    query = (
        select(number, episodes.c.outcome, episodes.c.robustness_m)
        .where(inside, number % every == 0, episodes.c.outcome != Outcome.FAILED)
        .order_by(number)
    )
    return tuple(
        EpisodeSample(index, Outcome(outcome), robustness_m)
        for index, outcome, robustness_m in connection.execute(query)
    )
