"""A reader of a database that shares no code with its writer: what the rows show of the promises.

`python tests/chaos/reader.py sqlite:///eigenfail-data/eigenfail.db` prints what it finds, and exits
with 1 if anything is lost, doubled or not as promised. It reads one state, and changes nothing.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType

import deadlines
from contents import digest_of, in_campaign, in_checkpoint, in_episode
from questions import ENDED, QUESTIONS
from sqlalchemy import Connection, NullPool, create_engine, make_url, text

DRIVERS = MappingProxyType({"postgresql": "postgresql+psycopg"})
SNAPSHOTS = {"sqlite": "BEGIN", "postgresql": "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"}
PATIENCE_S = deadlines.PROCESS_S

CAMPAIGNS = text("SELECT * FROM campaigns ORDER BY id")
CHECKPOINTS = text("SELECT * FROM checkpoints ORDER BY campaign, number")
INDICES = text('SELECT "index", digest FROM episodes WHERE campaign = :campaign ORDER BY "index"')
WHOLE = text(
    "SELECT e.*, t.z, t.sigma, t.states, s.scene FROM episodes e "
    'JOIN trajectories t ON t.campaign = e.campaign AND t."index" = e."index" '
    'LEFT JOIN scenes s ON s.campaign = e.campaign AND s."index" = e."index" '
    'WHERE e.campaign = :campaign ORDER BY e."index"'
)
BARE = text(
    "SELECT count(*) FROM episodes e LEFT JOIN trajectories t ON t.campaign = e.campaign "
    'AND t."index" = e."index" WHERE t.campaign IS NULL'
)


@dataclass(frozen=True)
class Findings:
    """What a database holds that it should not, and does not hold that it should.

    Attributes:
        lost: episodes that were counted but have no row, or no noise; or that are open for ever.
        doubled: rows beyond the first of an episode.
        repeated: results that came a second time and were counted, not kept.
        complaints: sentences, each with the promise that is broken.
        digests: of the results of each campaign, in index order, found anew from the rows.
    """

    lost: int
    doubled: int
    repeated: int
    complaints: tuple[str, ...]
    digests: MappingProxyType[int, str]

    @property
    def sound(self) -> bool:
        """Whether there is nothing to complain of."""
        return not (self.lost or self.doubled or self.complaints)


def read(url: str) -> Findings:
    """What is to be said of a database at rest: nobody writes, or what is written is whole.

    Args:
        url: sqlite:///file, or postgresql://…; its schema is the newest one.
    """
    with snapshot(url) as connection:
        campaigns = [dict(row) for row in connection.execute(CAMPAIGNS).mappings()]
        found = {row["id"]: Rows(connection, row) for row in campaigns}
        return Findings(
            lost=sum(rows.lost for rows in found.values()) + bare(connection),
            doubled=sum(rows.doubled for rows in found.values()),
            repeated=sum(row["duplicates"] for row in campaigns),
            complaints=(
                *broken_rules(connection),
                *(said for rows in found.values() for said in rows.complaints(connection)),
                *broken_checkpoints(connection, campaigns),
            ),
            digests=MappingProxyType({number: rows.digest for number, rows in found.items()}),
        )


@contextmanager
def snapshot(url: str) -> Iterator[Connection]:
    """A connection whose every question is answered from one and the same state."""
    parsed = make_url(url)
    parsed = parsed.set(drivername=DRIVERS.get(parsed.drivername, parsed.drivername))
    engine = create_engine(parsed, isolation_level="AUTOCOMMIT", poolclass=NullPool)
    with engine.connect() as connection:
        connection.exec_driver_sql(SNAPSHOTS[engine.dialect.name])
        try:
            yield connection
        finally:
            connection.exec_driver_sql("ROLLBACK")


class Rows:
    """The rows of one campaign beside what its own row says of them."""

    def __init__(self, connection: Connection, campaign: dict[str, object]) -> None:
        self._campaign = campaign
        rows = connection.execute(INDICES, {"campaign": campaign["id"]}).all()
        self._times = Counter(index for index, _ in rows)
        self.digest = digest_of(rows)

    @property
    def doubled(self) -> int:
        """Rows beyond the first of an episode."""
        return self._times.total() - len(self._times)

    @property
    def lost(self) -> int:
        """Episodes that are counted but not there, and those that nobody will run any more."""
        told = self._campaign
        finished = told["completed"] + told["failed"]
        left = told["planned"] - finished - told["cancelled"] if told["state"] in ENDED else 0
        return max(0, finished - len(self._times)) + max(0, left)

    def complaints(self, connection: Connection) -> Iterator[str]:
        """Of the campaign's own row, and of each episode's."""
        yield from in_campaign(self._campaign, self.digest)
        whole = connection.execute(WHOLE, {"campaign": self._campaign["id"]})
        for row in whole.mappings():
            yield from in_episode(dict(row), self._campaign["spec"])


def bare(connection: Connection) -> int:
    """How many episodes have lost their noise."""
    return connection.execute(BARE).scalar_one()


def broken_rules(connection: Connection) -> Iterator[str]:
    """A sentence for each row that a question finds."""
    for question in QUESTIONS:
        for row in connection.execute(text(question.sql)).mappings():
            yield f"{question.promise}: {question.sentence.format(**row)}"


def broken_checkpoints(connection: Connection, campaigns: list[dict[str, object]]) -> Iterator[str]:
    """What is wrong with the checkpoints."""
    specs = {row["id"]: row["spec"] for row in campaigns}
    for row in connection.execute(CHECKPOINTS).mappings():
        yield from in_checkpoint(row, specs[row["campaign"]])


def main() -> None:
    """Print; exit code 1 if anything is not as promised."""
    found = read(sys.argv[1])
    sys.stdout.write("".join(f"{said}\n" for said in found.complaints))
    sys.stdout.write(f"lost {found.lost}, doubled {found.doubled}, repeated {found.repeated}\n")
    sys.exit(not found.sound)


if __name__ == "__main__":
    main()
