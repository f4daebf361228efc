"""How many workers an episode took with it, in SQL."""

from sqlalchemy import Connection, insert, update

from eigenfail_services.store.schema import deaths


def add(connection: Connection, campaign: int, index: int) -> int:
    """One more, of a locked campaign; how many that makes."""
    count = (
        update(deaths)
        .where(deaths.c.campaign == campaign, deaths.c["index"] == index)
        .values(workers=deaths.c.workers + 1)
        .returning(deaths.c.workers)
    )
    if (workers := connection.execute(count).scalar_one_or_none()) is not None:
        return int(workers)
    connection.execute(insert(deaths).values(campaign=campaign, index=index, workers=1))
    return 1
