"""A database, held against what is promised of it."""

from collections.abc import Mapping, Sequence
from itertools import islice

from eigenfail.values.upkeep import Check, Verification
from eigenfail_services.store.engine import Database, find
from eigenfail_services.store.opening import open_database
from eigenfail_services.upkeep.checks import QUESTIONS, Question
from eigenfail_services.upkeep.files import PAGES, REFERENCES
from eigenfail_services.upkeep.mending import mend
from eigenfail_services.upkeep.replays import replays

MOST_SHOWN = 20

FILES: Mapping[str, Sequence[Question]] = {"sqlite": (PAGES,)}
"""Asked before all others, by kind of database: in a damaged file nothing else is looked at."""

ROWS: Mapping[str, Sequence[Question]] = {"sqlite": (REFERENCES,)}
"""Asked besides; PostgreSQL keeps references itself."""


def verify(address: str, how_many_replays: int = 0, *, repair: bool = False) -> Verification:
    """Check a database, whether or not a service runs on it; memory does not grow with it.

    Args:
        address: of the database; its schema must be this program's.
        how_many_replays: of stored episodes are run again; planners are looked up here.
        repair: first mend what is safe to mend, in one transaction.

    Raises:
        InvalidValue: the address is none.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is another.
        ServiceError: episodes are to be run, and cannot be here.
    """
    backend = find(address)
    database = open_database(backend, migrate=False)
    try:
        checks = answers(database, of_kind(database, FILES))
        if any(check.defects for check in checks):
            return Verification(backend.label, checks)
        mended = mend(database) if repair else ()
        more = (replays(database, how_many_replays),) if how_many_replays else ()
        checks += answers(database, (*of_kind(database, ROWS), *QUESTIONS, *more))
        return Verification(backend.label, checks, mended)
    finally:
        database.close()


def of_kind(database: Database, questions: Mapping[str, Sequence[Question]]) -> Sequence[Question]:
    """Those for this kind of database."""
    with database.reading() as connection:
        return questions.get(connection.dialect.name, ())


def answers(database: Database, questions: Sequence[Question]) -> tuple[Check, ...]:
    """What comes of each question."""
    return tuple(answered(database, question) for question in questions)


def answered(database: Database, question: Question) -> Check:
    """The first defects, and how many there are in all."""
    with database.reading() as connection:
        defects = question.ask(connection)
        shown = tuple(islice(defects, MOST_SHOWN))
        return Check(
            name=question.name,
            promise=question.promise,
            defects=len(shown) + sum(1 for _ in defects),
            shown=shown,
        )
