"""Verification of a database: defects, their places, and their remedies.

Each check is one statement whose rows are defects, so that a service may write meanwhile. Stored
episodes are replayed in separate processes, one for each campaign: a planner's changes to its
process affect neither other campaigns nor this process.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing
from hashlib import sha256
from itertools import accumulate, groupby, islice
from operator import itemgetter
from typing import Any

import msgspec
import sqlalchemy as sa
from sqlalchemy.exc import DatabaseError

from eigenfail import errors, functions, replays
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import FINAL_STATES
from eigenfail.values.episode import EpisodeTask, Outcome
from eigenfail.values.operations import DRAWN_AGAIN, Check, Defect, Verification
from eigenfail.values.records import JobKind
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.store import migrate as schema
from eigenfail_services.store.engine import Database, find_backend, read_kind
from eigenfail_services.store.jobs import LEASE_OVER, NOT_DEAD, SUBJECTS
from eigenfail_services.store.retention import NOISE, NOISE_PRUNED
from eigenfail_services.store.schema import (
    campaigns,
    checkpoints,
    episodes,
    is_failure,
    jobs,
    prunings,
    requirement_values,
    scenes,
    spec_field,
    trajectories,
)
from eigenfail_services.store.store import Store

AT_A_TIME = 500
"""Number of rows in memory at a time."""

RESTORE = "Restore a backup: eigenfail db restore."
ENDED_STATES: Mapping[JobKind, frozenset[str]] = {
    JobKind.CAMPAIGN: frozenset(FINAL_STATES),
    JobKind.ANALYSIS: frozenset({AnalysisState.DONE, AnalysisState.FAILED}),
}


class IntegrityCheck(msgspec.Struct, frozen=True):
    """A check of a database.

    Attributes:
        name: name of the check.
        promise: statement that holds without a defect.
        ask: yields the defects.
    """

    name: str
    promise: str
    ask: Callable[[sa.Connection], Iterator[Defect]]


def _iterate_rows(connection: sa.Connection, query: sa.Select[Any]) -> Iterator[sa.Row[Any]]:
    """Iterate over the rows of a query without loading all of them."""
    return iter(connection.execute(query.execution_options(yield_per=AT_A_TIME)))


def _count_rows() -> Any:
    """Return columns that count the rows of each campaign by outcome."""
    of_outcome = episodes.c.outcome
    return (
        sa.select(
            episodes.c.campaign,
            sa.func.count().label("ended"),
            sa.func.count().filter(of_outcome == Outcome.ERRORED).label("failed"),
            sa.func.count().filter(is_failure).label("failures"),
        )
        .group_by(episodes.c.campaign)
        .subquery()
        .c
    )


def _select_miscounted() -> sa.Select[Any]:
    """Select the campaigns whose counts differ from their rows, with both."""
    found = _count_rows()
    ended, failed, failures = (
        sa.func.coalesce(found[name], 0).label(f"rows_{name}")
        for name in ("ended", "failed", "failures")
    )
    wrong = sa.or_(
        campaigns.c.completed + campaigns.c.failed != ended,
        campaigns.c.failed != failed,
        campaigns.c.failures != failures,
        sa.and_(campaigns.c.state.not_in(FINAL_STATES), campaigns.c.cancelled != 0),
    )
    return (
        sa.select(campaigns, ended, failed, failures)
        .outerjoin(found.ended.table, found.campaign == campaigns.c.id)
        .where(wrong)
        .order_by(campaigns.c.id)
    )


def _check_counts(connection: sa.Connection) -> Iterator[Defect]:
    """Yield campaigns whose counts differ from their rows."""
    for found in _iterate_rows(connection, _select_miscounted()):
        stored = f"{found.completed} completed, {found.failed} errored, {found.failures} failures"
        there = (
            f"{found.rows_ended - found.rows_failed} completed, {found.rows_failed} errored, "
            f"{found.rows_failures} failures"
        )
        problem = f"It counts {stored}, {found.cancelled} cancelled; its rows are {there}."
        yield Defect(f"campaign {found.id}", problem, RESTORE)


def _check_ended(connection: sa.Connection) -> Iterator[Defect]:
    """Yield campaigns that have ended with open episodes."""
    total = campaigns.c.completed + campaigns.c.failed + campaigns.c.cancelled
    wrong = sa.select(campaigns).where(
        campaigns.c.state.in_(FINAL_STATES), total != campaigns.c.planned
    )
    for found in _iterate_rows(connection, wrong.order_by(campaigns.c.id)):
        left = found.planned - found.completed - found.failed - found.cancelled
        yield Defect(
            f"campaign {found.id}",
            f"It is {found.state}, and {left} of its episodes are open.",
            RESTORE,
        )


def _is_left_over(kind: JobKind) -> sa.ColumnElement[bool]:
    """Return the condition for free jobs of a kind whose subject has ended or does not exist."""
    subject = SUBJECTS[kind]
    # A job with a lease is at work, and its owner may be about to remove it.
    alive = sa.and_(subject.c.id == jobs.c.subject, subject.c.state.not_in(ENDED_STATES[kind]))
    return sa.and_(
        jobs.c.kind == kind, NOT_DEAD, LEASE_OVER, ~sa.exists().where(alive).correlate(jobs)
    )


def _check_jobs(connection: sa.Connection) -> Iterator[Defect]:
    """Yield jobs whose subject has ended or does not exist."""
    for kind in ENDED_STATES:
        for found in _iterate_rows(
            connection, sa.select(jobs).where(_is_left_over(kind)).order_by(jobs.c.id)
        ):
            yield Defect(
                f"job {found.id}",
                f"It is for {kind} {found.subject}, which has ended or is no more.",
                "It is removed at the next start of a service.",
            )


def _select_without(part: sa.Table, wanted: sa.ColumnElement[bool]) -> sa.Select[Any]:
    """Select the episodes that should have a row in another table and have none."""
    same = sa.and_(part.c.campaign == episodes.c.campaign, part.c["index"] == episodes.c["index"])
    missing = ~sa.exists().where(same).correlate(episodes)
    return sa.select(episodes.c.campaign, episodes.c["index"]).where(wanted, missing)


PARTS: Sequence[tuple[sa.Table, str, sa.ColumnElement[bool]]] = (
    (trajectories, "trajectory", ~sa.exists().where(NOISE_PRUNED).correlate(episodes)),
    (scenes, "scene", episodes.c.has_scene),
    (requirement_values, "robustness of requirements", episodes.c.nearest_m.is_not(None)),
)


def _check_parts(connection: sa.Connection) -> Iterator[Defect]:
    """Yield episodes without their noise, or without the scene that they should have."""
    for table, name, wanted in PARTS:
        for found in _iterate_rows(connection, _select_without(table, wanted)):
            where = f"episode {found.campaign}/{found.index}"
            yield Defect(where, f"Its {name} is missing.", RESTORE)


def _check_prunings(connection: sa.Connection) -> Iterator[Defect]:
    """Yield campaigns whose number of episodes without noise differs from the recorded prunings."""
    of_campaign = episodes.c.campaign == prunings.c.campaign
    silent = (
        sa.select(sa.func.count())
        .select_from(episodes)
        .where(of_campaign, ~sa.exists().where(NOISE))
    )
    sums = sa.select(
        prunings.c.campaign,
        sa.func.sum(prunings.c.episodes).label("recorded"),
        silent.correlate(prunings).scalar_subquery().label("silent"),
    )
    for found in _iterate_rows(connection, sums.group_by(prunings.c.campaign)):
        if found.recorded != found.silent:
            counts = f"{found.silent} episodes are without noise; {found.recorded} were pruned."
            yield Defect(f"campaign {found.campaign}", counts, RESTORE)


def _check_checkpoints(connection: sa.Connection) -> Iterator[Defect]:
    """Yield checkpoints that have changed since they were saved, or cannot be read."""
    keys = sa.select(checkpoints.c.campaign, checkpoints.c.number).order_by(
        *checkpoints.primary_key
    )
    whole = sa.select(checkpoints.c.state, checkpoints.c.sha256)
    # All keys are loaded at once, and states one by one: a state may have many megabytes.
    for campaign, number in connection.execute(keys).all():
        this = sa.and_(checkpoints.c.campaign == campaign, checkpoints.c.number == number)
        found = connection.execute(whole.where(this)).one_or_none()
        if found and (problem := _describe_damage(found.state, found.sha256)):
            remedy = "An older one is used if it is intact; otherwise launch the campaign again."
            yield Defect(f"campaign {campaign}, checkpoint {number}", problem, remedy)


def _describe_damage(state: bytes, digest: str | None) -> str:
    """Return the damage of a checkpoint; empty if a learner can start from it."""
    if digest is not None and sha256(state).hexdigest() != digest:
        return "It is not what was saved: its SHA-256 does not match."
    try:
        read_checkpoint(state)
    except errors.ProtocolError as error:
        return error.problem
    return ""


CHECKS = (
    IntegrityCheck("accounts", "Counts of campaigns are those of their rows.", _check_counts),
    IntegrityCheck("ends", "No campaign that has ended has open episodes.", _check_ended),
    IntegrityCheck("jobs", "No job is left over for what has ended.", _check_jobs),
    IntegrityCheck(
        "parts",
        "Every episode has its trajectory unless it was pruned, and its scene if it says so.",
        _check_parts,
    ),
    IntegrityCheck(
        "prunings", "As many episodes are without noise as were pruned.", _check_prunings
    ),
    IntegrityCheck("checkpoints", "Every checkpoint can be read.", _check_checkpoints),
)


FINE = "ok"


def _check_pages(connection: sa.Connection) -> Iterator[Defect]:
    """Yield damaged pages of the file."""
    try:
        for (found,) in connection.exec_driver_sql("PRAGMA quick_check"):
            if found != FINE:
                yield Defect("file", f"{found}.", RESTORE)
    except DatabaseError as error:
        connection.rollback()  # after such an error SQLite cannot commit even an empty transaction
        yield Defect("file", f"It cannot be read to its end: {error.orig}.", RESTORE)


def _check_references(connection: sa.Connection) -> Iterator[Defect]:
    """Yield rows that refer to missing rows."""
    for table, row, parent, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield Defect(f"{table}, row {row}", f"It belongs to no row of {parent}.", RESTORE)


PAGES = IntegrityCheck("file", "SQLite finds every page of the file in order.", _check_pages)
REFERENCES = IntegrityCheck(
    "references", "Every row has the row that it belongs to.", _check_references
)


DIFFERENT = (
    "It ran on another type of machine or under other versions, or the database was changed, or "
    "something is not deterministic: docs/reliability.md."
)

REPLAY_REMEDY = (
    "Replay it alone with `eigenfail episode replay`: its planner or simulator ends or hangs."
)


def make_replay_check(database: Database, how_many: int) -> IntegrityCheck:
    """Return the check that a number of episodes have the same digest when they are run again."""
    store = Store(database)
    with database.reading() as connection:
        left_out = _find_unlisted(connection)

    def ask(connection: sa.Connection) -> Iterator[Defect]:
        replays.load_engine()  # where episodes cannot be run at all, that is no defect of each
        chosen = sample(connection, how_many, left_out)
        for campaign, places in groupby(chosen, itemgetter(0)):
            yield from _find_differences(store, campaign, [index for _, index in places])

    promise = f"{how_many} episodes, run again, have the same digest."
    return IntegrityCheck("replays", f"{promise}{_describe_left_out(left_out)}", ask)


def _find_unlisted(connection: sa.Connection) -> dict[int, str]:
    """Return the campaigns on functions that may not be run here, with their modules."""
    of_functions = spec_field("simulator") == functions.SIMULATOR
    query = sa.select(campaigns.c.id, spec_field("planner")).where(of_functions)
    found = connection.execute(query.order_by(campaigns.c.id)).all()
    return {
        campaign: place.partition(":")[0]
        for campaign, place in found
        if not functions.is_listed(place)
    }


def _describe_left_out(left_out: Mapping[int, str]) -> str:
    """Return the sentence about campaigns that were left out, and the setting to include them."""
    if not left_out:
        return ""
    modules = ",".join(sorted(set(left_out.values())))
    numbers = ", ".join(map(str, left_out))
    needed = f"{functions.ALLOWED_VARIABLE}={modules}"
    return f" Left out without {needed}, whose functions they run: campaigns {numbers}."


def sample(
    connection: sa.Connection, how_many: int, left_out: Collection[int] = ()
) -> list[tuple[int, int]]:
    """Return completed episodes at even distances, the same at each call."""
    query = sa.select(campaigns.c.id, campaigns.c.completed).where(campaigns.c.completed > 0)
    found = connection.execute(query.order_by(campaigns.c.id)).all()
    sizes = [(campaign, size) for campaign, size in found if campaign not in left_out]
    ends = list(accumulate(size for _, size in sizes))
    total = ends[-1] if ends else 0
    # Spread over all campaigns by their sizes: a large campaign is sampled more often.
    places = sorted({total * k // how_many for k in range(how_many)} if total else set())
    return [
        (campaign, index)
        for (campaign, size), end in zip(sizes, ends, strict=True)
        for place in places
        if end - size <= place < end
        for index in _find_nth_episode(connection, campaign, place - (end - size))
    ]


def _find_nth_episode(connection: sa.Connection, campaign: int, place: int) -> Sequence[int]:
    """Return the index of a campaign's n-th completed episode, if there are as many."""
    number = episodes.c["index"]
    of_campaign = (episodes.c.campaign == campaign) & (episodes.c.outcome != Outcome.ERRORED)
    query = sa.select(number).where(of_campaign).order_by(number).limit(1).offset(place)
    return connection.execute(query).scalars().all()


def _read_stored(store: Store, campaign: int, index: int) -> tuple[EpisodeTask, str] | None:
    """Return the task that runs an episode again, and its stored digest.

    Pruned noise is drawn again from the episode's seed. The answer is None if the noise does not
    follow from the seed; the user who pruned the noise accepted that.
    """
    try:
        stored = store.episodes.get(campaign, index)
    except errors.NoisePruned:
        (row,) = store.episodes.page(campaign, 1, after=index - 1).items
        if row.source != DRAWN_AGAIN:
            return None
        return replays.make_redraw_task(index, row.seed), row.digest
    return replays.make_replay_task(stored), stored.digest()


def _find_differences(store: Store, campaign: int, indices: Sequence[int]) -> Iterator[Defect]:
    """Yield a defect for each episode whose second run differs from the stored result."""
    stored = [each for index in indices if (each := _read_stored(store, campaign, index))]
    waiting = [(f"episode {campaign}/{task.index}", digest) for task, digest in stored]
    again = replays.replay_in_process(
        store.campaigns.get(campaign).spec, [task for task, _ in stored]
    )
    try:
        for replayed in again:
            # What is still in the list when the replays break off was not run.
            where, digest = waiting.pop(0)
            if isinstance(replayed, errors.ServiceError):
                yield Defect(where, f"It cannot be run here: {replayed.problem}", REPLAY_REMEDY)
            elif replayed.digest != digest:
                found = f"Its digest is {digest}; run again it is {replayed.digest}."
                errored = f" The second run is errored: {replayed.problem}"
                yield Defect(where, found + errored * bool(replayed.problem), DIFFERENT)
    except errors.InputError as error:
        for where, _ in waiting:
            yield Defect(where, f"It cannot be run here: {error.problem}", error.remedy)


MAX_SHOWN = 20

FILE_CHECKS: Mapping[str, Sequence[IntegrityCheck]] = {"sqlite": (PAGES,)}
"""Checks that come first, by kind of database: of a damaged file nothing else is checked."""

ROW_CHECKS: Mapping[str, Sequence[IntegrityCheck]] = {"sqlite": (REFERENCES,)}
"""Additional checks by kind of database; PostgreSQL enforces references itself."""


def verify(address: str, how_many_replays: int = 0) -> Verification:
    """Check a database, which a service may use meanwhile, in bounded memory.

    Args:
        address: address of the database; its schema must be this program's.
        how_many_replays: number of stored episodes to run again with the planners installed here.

    Raises:
        InvalidValue: the address is invalid.
        StoreUnavailable: the database does not exist, or does not answer.
        SchemaMismatch: its schema is not this program's.
        ServiceError: episodes cannot be run here.
    """
    backend, kind = find_backend(address), read_kind(address)
    backend.require()
    with closing(Database(backend)) as database:
        try:
            checks = _run_checks(database, FILE_CHECKS.get(kind, ()))
        except errors.StoreDamaged as error:  # not a single page of it can be read
            damage = Defect("file", error.problem, error.remedy)
            return Verification(backend.label, (Check(PAGES.name, PAGES.promise, 1, (damage,)),))
        if any(check.defects for check in checks):
            return Verification(backend.label, checks)
        # The version is read after the pages were checked: a damaged file may hold any version.
        schema.ensure_newest(database, backend, migrate=False)
        more = (make_replay_check(database, how_many_replays),) if how_many_replays else ()
        checks += _run_checks(database, (*ROW_CHECKS.get(kind, ()), *CHECKS, *more))
        return Verification(backend.label, checks)


def _run_checks(database: Database, questions: Sequence[IntegrityCheck]) -> tuple[Check, ...]:
    """Return the results of checks, in order."""
    return tuple(_run_check(database, question) for question in questions)


def _run_check(database: Database, question: IntegrityCheck) -> Check:
    """Return a check's first defects and their total number."""
    with database.reading() as connection:
        defects = question.ask(connection)
        # All defects are counted and only the first ones kept: a damaged database may have
        # millions.
        shown = tuple(islice(defects, MAX_SHOWN))
        return Check(
            name=question.name,
            promise=question.promise,
            defects=len(shown) + sum(1 for _ in defects),
            shown=shown,
        )
