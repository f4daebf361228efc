"""Stored episodes run again: some of them, spread over all that there are."""

from collections.abc import Iterator, Sequence
from itertools import accumulate

from sqlalchemy import Connection, select

from eigenfail.contracts import Store
from eigenfail.errors import InputError, NoisePruned
from eigenfail.stories.replays import redraw_episode, replay_episode
from eigenfail.values import Outcome, Replayed
from eigenfail.values.retention import DRAWN_AGAIN
from eigenfail.values.upkeep import Defect
from eigenfail_services.store.schema import campaigns, episodes
from eigenfail_services.upkeep.checks import Question

DIFFERENT = (
    "It ran on another type of machine or under other versions, or the database was changed, or "
    "something is not deterministic: docs/reliability.md."
)


def replays(store: Store, how_many: int) -> Question:
    """The question whether so many episodes have the same digest when they are run again."""

    def ask(connection: Connection) -> Iterator[Defect]:
        for campaign, index in sample(connection, how_many):
            yield from difference(store, campaign, index)

    return Question("replays", f"{how_many} episodes, run again, have the same digest.", ask)


def sample(connection: Connection, how_many: int) -> list[tuple[int, int]]:
    """Episodes at even distances among all that were completed: the same ones every time."""
    query = select(campaigns.c.id, campaigns.c.completed).where(campaigns.c.completed > 0)
    sizes = connection.execute(query.order_by(campaigns.c.id)).all()
    ends = list(accumulate(size for _, size in sizes))
    total = ends[-1] if ends else 0
    places = sorted({total * k // how_many for k in range(how_many)} if total else set())
    return [
        (campaign, index)
        for (campaign, size), end in zip(sizes, ends, strict=True)
        for place in places
        if end - size <= place < end
        for index in nth(connection, campaign, place - (end - size))
    ]


def nth(connection: Connection, campaign: int, place: int) -> Sequence[int]:
    """The index of a campaign's n-th completed episode; none if there are fewer."""
    number = episodes.c["index"]
    of_campaign = (episodes.c.campaign == campaign) & (episodes.c.outcome != Outcome.FAILED)
    query = select(number).where(of_campaign).order_by(number).limit(1).offset(place)
    return connection.execute(query).scalars().all()


def run_again(store: Store, campaign: int, index: int) -> Replayed | None:
    """An episode's second run; of one that lost its noise, from its seed.

    None if it does not follow from that: whoever had the noise taken away was told so.
    """
    spec = store.campaigns.get(campaign).spec
    try:
        return replay_episode(spec, store.episodes.get(campaign, index))
    except NoisePruned:
        (row,) = store.episodes.page(campaign, 1, after=index - 1).items
        return redraw_episode(spec, row) if row.source == DRAWN_AGAIN else None


def difference(store: Store, campaign: int, index: int) -> Iterator[Defect]:
    """What an episode's second run shows, if it is not what is stored."""
    where = f"episode {campaign}/{index}"
    try:
        again = run_again(store, campaign, index)
    except InputError as error:
        yield Defect(where, f"It cannot be run here: {error.problem}", error.remedy)
        return
    if again is not None and not again.same:
        found = f"Its digest is {again.stored_digest}; run again it is {again.digest}."
        yield Defect(where, found, DIFFERENT)
