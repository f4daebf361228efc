"""What is promised of a database, as questions to it; an answer is something that is wrong.

Each question is one statement, so that a service may write meanwhile; answers come one by one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any

import msgspec
from sqlalchemy import (
    ColumnElement,
    Connection,
    Row,
    Select,
    Table,
    and_,
    exists,
    func,
    or_,
    select,
)

from eigenfail.errors import ProtocolError
from eigenfail.values import FINAL_STATES, AnalysisState, Outcome
from eigenfail.values.records import JobKind
from eigenfail.values.upkeep import Defect
from eigenfail_services.campaigns.checkpoint import read_checkpoint
from eigenfail_services.store.jobs import NOT_BURIED, SUBJECTS
from eigenfail_services.store.leases import LEASE_OVER
from eigenfail_services.store.retention import NOISE, TAKEN
from eigenfail_services.store.schema import (
    campaigns,
    checkpoints,
    episodes,
    jobs,
    prunings,
    scenes,
    trajectories,
)

AT_A_TIME = 500
"""Rows that are in memory together."""

REPAIR = "eigenfail db verify --repair"
RESTORE = "Restore a backup: eigenfail db restore."
ENDED: Mapping[JobKind, frozenset[str]] = {
    JobKind.CAMPAIGN: frozenset(FINAL_STATES),
    JobKind.ANALYSIS: frozenset({AnalysisState.DONE, AnalysisState.FAILED}),
}


class Question(msgspec.Struct, frozen=True):
    """A check: what it is called, what holds if nothing comes of it, and how it is asked."""

    name: str
    promise: str
    ask: Callable[[Connection], Iterator[Defect]]


def rows(connection: Connection, query: Select[Any]) -> Iterator[Row[Any]]:
    """Rows as they come; never all of them at once."""
    return iter(connection.execute(query.execution_options(yield_per=AT_A_TIME)))


def counted() -> Any:
    """What the rows of each campaign that has any amount to."""
    of_outcome = episodes.c.outcome
    return (
        select(
            episodes.c.campaign,
            func.count().label("ended"),
            func.count().filter(of_outcome == Outcome.FAILED).label("failed"),
            func.count().filter(of_outcome == Outcome.COLLISION).label("failures"),
        )
        .group_by(episodes.c.campaign)
        .subquery()
        .c
    )


def miscounted() -> Select[Any]:
    """Campaigns whose counts are not those of their rows, with both."""
    found = counted()
    ended, failed, failures = (
        func.coalesce(found[name], 0).label(f"rows_{name}")
        for name in ("ended", "failed", "failures")
    )
    wrong = or_(
        campaigns.c.completed + campaigns.c.failed != ended,
        campaigns.c.failed != failed,
        campaigns.c.failures != failures,
        and_(campaigns.c.state.not_in(FINAL_STATES), campaigns.c.cancelled != 0),
    )
    return (
        select(campaigns, ended, failed, failures)
        .outerjoin(found.ended.table, found.campaign == campaigns.c.id)
        .where(wrong)
        .order_by(campaigns.c.id)
    )


def accounts(connection: Connection) -> Iterator[Defect]:
    """Counts against rows."""
    for found in rows(connection, miscounted()):
        told = f"{found.completed} completed, {found.failed} failed, {found.failures} failures"
        there = (
            f"{found.rows_ended - found.rows_failed} completed, {found.rows_failed} failed, "
            f"{found.rows_failures} failures"
        )
        mendable = found.rows_ended <= found.planned
        yield Defect(
            f"campaign {found.id}",
            f"It counts {told}, {found.cancelled} cancelled; its rows are {there}.",
            f"Count anew: {REPAIR}." if mendable else f"More rows than planned. {RESTORE}",
        )


def unaccounted() -> Select[Any]:
    """Campaigns that have ended with open episodes."""
    total = campaigns.c.completed + campaigns.c.failed + campaigns.c.cancelled
    return select(campaigns).where(
        campaigns.c.state.in_(FINAL_STATES), total != campaigns.c.planned
    )


def open_ends(connection: Connection) -> Iterator[Defect]:
    """Campaigns that have ended, and yet have open episodes."""
    for found in rows(connection, unaccounted().order_by(campaigns.c.id)):
        left = found.planned - found.completed - found.failed - found.cancelled
        yield Defect(
            f"campaign {found.id}",
            f"It is {found.state}, and {left} of its episodes are open.",
            f"Count them as cancelled: {REPAIR}.",
        )


def left_over(kind: JobKind) -> ColumnElement[bool]:
    """Jobs of a kind that nobody holds, though what they were for has ended or is no more."""
    subject = SUBJECTS[kind]
    alive = and_(subject.c.id == jobs.c.subject, subject.c.state.not_in(ENDED[kind]))
    return and_(jobs.c.kind == kind, NOT_BURIED, LEASE_OVER, ~exists().where(alive).correlate(jobs))


def left_over_jobs(connection: Connection) -> Iterator[Defect]:
    """Jobs for what has ended."""
    for kind in ENDED:
        for found in rows(connection, select(jobs).where(left_over(kind)).order_by(jobs.c.id)):
            yield Defect(
                f"job {found.id}",
                f"It is for {kind} {found.subject}, which has ended or is no more.",
                f"The next service takes it away; so does {REPAIR}.",
            )


def without(part: Table, wanted: ColumnElement[bool]) -> Select[Any]:
    """Episodes that should have a row in another table and have none."""
    same = and_(part.c.campaign == episodes.c.campaign, part.c["index"] == episodes.c["index"])
    missing = ~exists().where(same).correlate(episodes)
    return select(episodes.c.campaign, episodes.c["index"]).where(wanted, missing)


PARTS: Sequence[tuple[Table, str, ColumnElement[bool]]] = (
    (trajectories, "trajectory", ~exists().where(TAKEN).correlate(episodes)),
    (scenes, "scene", episodes.c.has_scene),
)


def missing_parts(connection: Connection) -> Iterator[Defect]:
    """Episodes without their noise, or without the scene that they are said to have."""
    for table, name, wanted in PARTS:
        for found in rows(connection, without(table, wanted)):
            where = f"episode {found.campaign}/{found.index}"
            yield Defect(where, f"Its {name} is missing.", RESTORE)


def misrecorded(connection: Connection) -> Iterator[Defect]:
    """Campaigns of which more, or fewer, episodes are without noise than was recorded."""
    of_campaign = episodes.c.campaign == prunings.c.campaign
    silent = select(func.count()).select_from(episodes).where(of_campaign, ~exists().where(NOISE))
    sums = select(
        prunings.c.campaign,
        func.sum(prunings.c.episodes).label("recorded"),
        silent.correlate(prunings).scalar_subquery().label("silent"),
    )
    for found in rows(connection, sums.group_by(prunings.c.campaign)):
        if found.recorded != found.silent:
            told = f"{found.silent} episodes are without noise; {found.recorded} were pruned."
            yield Defect(f"campaign {found.campaign}", told, RESTORE)


def unreadable_checkpoints(connection: Connection) -> Iterator[Defect]:
    """Checkpoints that are not what was saved, or that no learner could go on from."""
    keys = select(checkpoints.c.campaign, checkpoints.c.number).order_by(*checkpoints.primary_key)
    whole = select(checkpoints.c.state, checkpoints.c.sha256)
    # The keys alone are small; a state may have many megabytes.
    for campaign, number in connection.execute(keys).all():
        this = and_(checkpoints.c.campaign == campaign, checkpoints.c.number == number)
        found = connection.execute(whole.where(this)).one_or_none()
        if found and (problem := damage(found.state, found.sha256)):
            remedy = "An older one is used if it is whole; else start the campaign anew."
            yield Defect(f"campaign {campaign}, checkpoint {number}", problem, remedy)


def damage(state: bytes, digest: str | None) -> str:
    """What is wrong with a checkpoint; nothing if a learner can go on from it."""
    if digest is not None and sha256(state).hexdigest() != digest:
        return "It is not what was saved: its SHA-256 does not match."
    try:
        read_checkpoint(state)
    except ProtocolError as error:
        return error.problem
    return ""


QUESTIONS = (
    Question("accounts", "Counts of campaigns are those of their rows.", accounts),
    Question("ends", "No campaign that has ended has open episodes.", open_ends),
    Question("jobs", "No job is left over for what has ended.", left_over_jobs),
    Question(
        "parts",
        "Every episode has its trajectory unless it was pruned, and its scene if it says so.",
        missing_parts,
    ),
    Question("prunings", "As many episodes are without noise as were pruned.", misrecorded),
    Question("checkpoints", "Every checkpoint can be read.", unreadable_checkpoints),
)
