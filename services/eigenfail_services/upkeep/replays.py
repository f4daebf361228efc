"""Stored episodes run again: some of them, spread over all that there are."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import accumulate

from sqlalchemy import Connection, select

from eigenfail import functions
from eigenfail.contracts import Store
from eigenfail.errors import InputError, NoisePruned
from eigenfail.stories.replays import redraw_episode, replay_episode
from eigenfail.values import Outcome, Replayed
from eigenfail.values.retention import DRAWN_AGAIN
from eigenfail.values.upkeep import Defect
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import campaigns, episodes
from eigenfail_services.store.spec_fields import spec_field
from eigenfail_services.store.sql import SqlStore
from eigenfail_services.upkeep.checks import Question

DIFFERENT = (
    "It ran on another type of machine or under other versions, or the database was changed, or "
    "something is not deterministic: docs/reliability.md."
)


def replays(database: Database, how_many: int) -> Question:
    """The question whether so many episodes have the same digest when they are run again."""
    store = SqlStore(database)
    with database.reading() as connection:
        left_out = unlisted(connection)

    def ask(connection: Connection) -> Iterator[Defect]:
        for campaign, index in sample(connection, how_many, left_out):
            yield from difference(store, campaign, index)

    promise = f"{how_many} episodes, run again, have the same digest."
    return Question("replays", f"{promise}{words(left_out)}", ask)


def unlisted(connection: Connection) -> dict[int, str]:
    """Campaigns on functions that may not be run here, with their modules: they are no defects."""
    of_functions = spec_field("simulator") == functions.SIMULATOR
    query = select(campaigns.c.id, spec_field("planner")).where(of_functions)
    found = connection.execute(query.order_by(campaigns.c.id)).all()
    return {
        campaign: place.partition(":")[0]
        for campaign, place in found
        if not functions.is_listed(place)
    }


def words(left_out: Mapping[int, str]) -> str:
    """Which campaigns were not run again, and what would run them."""
    if not left_out:
        return ""
    modules = ",".join(sorted(set(left_out.values())))
    numbers = ", ".join(map(str, left_out))
    needed = f"{functions.ALLOWED_VARIABLE}={modules}"
    return f" Left out without {needed}, whose functions they run: campaigns {numbers}."


def sample(
    connection: Connection, how_many: int, left_out: Collection[int] = ()
) -> list[tuple[int, int]]:
    """Episodes at even distances among all that were completed: the same ones every time."""
    query = select(campaigns.c.id, campaigns.c.completed).where(campaigns.c.completed > 0)
    found = connection.execute(query.order_by(campaigns.c.id)).all()
    sizes = [(campaign, size) for campaign, size in found if campaign not in left_out]
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
