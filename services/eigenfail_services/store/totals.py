"""Sums over the episodes of campaigns, computed by the database.

Sums of floats depend on their order, and reports must not: values are added in index order.
"""

from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from math import ceil, fsum
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
import sqlalchemy as sa
from msgspec.structs import replace
from numpy.typing import NDArray

from eigenfail.values import records, safety
from eigenfail.values.comparison import PairTotals
from eigenfail.values.episode import FAILURES, Outcome
from eigenfail.values.scene import PEAK_BRAKING_MPS2
from eigenfail.values.summary import BlockTotals, SpendingTotals, StoredProgress
from eigenfail_services.store.codec import to_row
from eigenfail_services.store.schema import (
    ENDED_COLUMNS,
    campaigns,
    episode_index,
    episodes,
    has_no_collision,
    is_failure,
    is_hopeless,
    is_unresolved,
    requirement_values,
    spec_field,
)

_CHUNK = 10_000
"""Number of rows that are fetched at a time."""

_Column = NDArray[np.float64]

_FAILED = sa.cast(is_failure, sa.Integer)

_COMPLETED = episodes.c.outcome != Outcome.ERRORED


def _read_columns(
    connection: sa.Connection, query: sa.Select[*tuple[Any, ...]]
) -> tuple[_Column, ...]:
    """Return the columns of a query's answer as arrays; NaN marks a missing value."""
    parts = [np.empty((0, len(query.selected_columns)))]
    with closing(connection.execute(query)) as answer:
        # The driver's rows as they are: ours would take three times as long.
        while rows := answer.cursor.fetchmany(_CHUNK):
            parts.append(np.array(rows, np.float64))
    return tuple(np.concatenate(parts).T)


def sum_blocks(connection: sa.Connection, campaign: int, per: int) -> list[BlockTotals]:
    """Return sums over blocks of `per` indices that have a completed episode, in index order."""
    query = (
        sa.select(episode_index, _FAILED, episodes.c.robustness_m, episodes.c.log_probability)
        .add_columns(episodes.c.steps, sa.cast(is_unresolved, sa.Integer))
        .where(episodes.c.campaign == campaign, _COMPLETED)
        # Rows are read in the order in which they were written, one behind the other, and are
        # sorted below.
        .order_by(episodes.c.finished_ms, episode_index)
    )
    landed = _read_columns(connection, query)
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    index, *measured = (column[np.argsort(landed[0])] for column in landed)
    blocks, begins = np.unique(index // per, return_index=True)
    if not len(blocks):
        return []
    parts = zip(*(np.split(column, begins[1:]) for column in measured), strict=True)
    errored = _count_errored(connection, campaign, per)
    found = []
    for place, (*summed, ended) in zip(blocks.astype(int).tolist(), parts, strict=True):
        totals = _sum_block(place * per, *summed)
        unresolved = int((ended == 1.0).sum())
        found.append(replace(totals, errored=errored[place], unresolved=unresolved))
    return found


def _count_errored(connection: sa.Connection, campaign: int, per: int) -> Counter[int]:
    """Return the number of errored episodes of each block that has one."""
    inside = (episodes.c.campaign == campaign, episodes.c.outcome == Outcome.ERRORED)
    found = connection.execute(sa.select(episode_index).where(*inside))
    return Counter(row[0] // per for row in found)


def _sum_block(
    first: int, failed: _Column, robustness_m: _Column, log_probability: _Column, steps: _Column
) -> BlockTotals:
    failures = failed == 1.0
    known_m = robustness_m[~np.isnan(robustness_m)]
    return BlockTotals(
        first=first,
        completed=len(failed),
        failures=int(failures.sum()),
        log_probability=sum(log_probability[failures].tolist(), 0.0),
        steps=int(steps[failures].sum()),
        smallest_robustness_m=float(known_m.min()) if len(known_m) else None,
        median_robustness_m=float(np.median(known_m)) if len(known_m) else None,
    )


def count_pairs(connection: sa.Connection, first: int, second: int) -> PairTotals:
    """Count the episodes that two campaigns both completed with one seed and source, by outcome."""
    other = episodes.alias()
    same = sa.and_(
        other.c["index"] == episode_index,
        other.c.seed == episodes.c.seed,
        other.c.source == episodes.c.source,
    )
    one_failed = is_failure
    other_failed = other.c.outcome.in_(FAILURES)
    query = (
        sa.select(
            sa.func.count().filter(one_failed, other_failed).label("both"),
            sa.func.count().filter(one_failed, ~other_failed).label("only_first"),
            sa.func.count().filter(~one_failed, other_failed).label("only_second"),
            sa.func.count().filter(~one_failed, ~other_failed).label("neither"),
        )
        .select_from(episodes)
        .join(other, same)
        .where(
            episodes.c.campaign == first,
            other.c.campaign == second,
            episodes.c.outcome != Outcome.ERRORED,
            other.c.outcome != Outcome.ERRORED,
        )
    )
    return PairTotals(*connection.execute(query).one())


def sum_safety(connection: sa.Connection, campaign: int, most: int) -> safety.SafetyTotals:
    """Return safety measures of the completed episodes, and at most `most` failures as points.

    Memory grows with the campaign by two numbers for each failure only.
    """
    done = sa.select(sa.func.count(), sa.func.sum(_FAILED)).where(
        episodes.c.campaign == campaign, _COMPLETED
    )
    count, failures = connection.execute(done).one()
    crashed, severities = _read_columns(connection, _select_severities(campaign))
    every = max(1, ceil(len(crashed) / most))
    return safety.SafetyTotals(
        completed=count,
        failures=failures or 0,
        ttc=_sum_measure(connection, campaign, _TTC),
        drac=_sum_measure(connection, campaign, _DRAC),
        severities=severities,
        points=_read_points(connection, campaign, crashed[::every].astype(int).tolist()),
        requirements=_count_violations(connection, campaign),
    )


def sample_severities(
    connection: sa.Connection, campaign: int, first: int
) -> safety.SeveritySample:
    """Return the severities of the failures from an index on."""
    failed = sa.select(sa.func.sum(_FAILED)).where(
        episodes.c.campaign == campaign, _COMPLETED, episode_index >= first
    )
    query = _select_severities(campaign).where(episode_index >= first)
    return safety.SeveritySample(
        failures=connection.execute(failed).scalar_one() or 0,
        severities=tuple(_read_columns(connection, query)[1].tolist()),
    )


def _count_violations(
    connection: sa.Connection, campaign: int
) -> tuple[safety.RequirementTotals, ...]:
    """Count violations of each requirement that the campaign names; empty if it names none."""
    value, number = requirement_values.c.robustness, requirement_values.c.requirement
    query = (
        sa.select(number, sa.func.count(), sa.func.count().filter(value <= 0.0), sa.func.min(value))
        .where(requirement_values.c.campaign == campaign)
        .group_by(number)
    )
    found = {row[0]: safety.RequirementTotals(*row[1:]) for row in connection.execute(query)}
    # One that no episode was judged by has no row.
    return tuple(found.get(each, NOT_JUDGED) for each in range(1, max(found, default=0) + 1))


NOT_JUDGED = safety.RequirementTotals(0, 0, None)


class _Threshold(NamedTuple):
    """A measure, the condition for values beyond its threshold, and its worst value."""

    column: sa.ColumnElement[float]
    beyond: sa.ColumnElement[bool]
    worst: sa.ColumnElement[float]


_TTC = _Threshold(
    episodes.c.min_ttc_s,
    episodes.c.min_ttc_s < records.NEAR_MISS_TTC_S,
    sa.func.min(episodes.c.min_ttc_s),
)
_DRAC = _Threshold(
    episodes.c.max_drac_mps2,
    episodes.c.max_drac_mps2 > PEAK_BRAKING_MPS2,
    sa.func.max(episodes.c.max_drac_mps2),
)


def _sum_measure(connection: sa.Connection, campaign: int, of: _Threshold) -> safety.MeasureTotals:
    """Sum up a measure over the completed episodes that have it; an index holds them in order."""
    inside = (episodes.c.campaign == campaign, _COMPLETED, of.column.is_not(None))
    query = sa.select(sa.func.count(), sa.func.count().filter(of.beyond), of.worst).where(*inside)
    count, beyond, worst = connection.execute(query).one()
    if not count:
        return safety.MeasureTotals()
    middle = (
        sa.select(of.column)
        .where(*inside)
        .order_by(of.column)
        .offset((count - 1) // 2)
        .limit(2 - count % 2)
    )
    return safety.MeasureTotals(count, beyond, fmean(connection.execute(middle).scalars()), worst)


def _select_severities(campaign: int) -> sa.Select[*tuple[Any, ...]]:
    return (
        sa.select(episode_index, episodes.c.severity)
        .where(
            episodes.c.campaign == campaign,
            episodes.c.outcome == Outcome.COLLISION,
            episodes.c.severity.is_not(None),
        )
        .order_by(episode_index)
    )


def _read_points(
    connection: sa.Connection, campaign: int, chosen: Sequence[int]
) -> tuple[safety.FailurePoint, ...]:
    query = sa.select(episodes).where(episodes.c.campaign == campaign, episode_index.in_(chosen))
    rows = map(to_row, connection.execute(query.order_by(episode_index)).mappings())
    return tuple(
        safety.FailurePoint(
            row.index, row.log_probability / max(row.steps, 1), row.severity, row.assessed.conflict
        )
        for row in rows
        if row.severity is not None
    )


def sum_spending(connection: sa.Connection, campaign: int, most: int) -> SpendingTotals:
    """Return the worker time of all episodes, and the progress at `most` of them and the last."""
    inside = episodes.c.campaign == campaign
    completed = connection.execute(
        sa.select(sa.func.count()).where(inside, _COMPLETED)
    ).scalar_one()
    errored = sa.select(episodes.c.wall_s).where(inside, ~_COMPLETED)
    found = connection.execute(_select_progress(campaign, completed, most)).all()
    return SpendingTotals(
        completed_worker_s=found[-1].worker_s if found else 0.0,
        # `fsum` does not depend on the order of its terms, and these rows have no fixed order.
        errored_worker_s=fsum(connection.execute(errored).scalars()),
        progress=tuple(
            StoredProgress(each.finished_ms, each.place, each.failures) for each in found
        ),
    )


def _select_progress(campaign: int, completed: int, most: int) -> sa.Select[*tuple[Any, ...]]:
    """Select every k-th completed episode in storage order, and the last one.

    Each row has the numbers of episodes and failures and the worker time up to it.
    """
    order = (episodes.c.finished_ms, episode_index)
    # By rows, not by range: two that landed at the same time are two.
    until = (None, 0)
    failures = sa.func.count().filter(is_failure)
    landed = (
        sa.select(
            episodes.c.finished_ms,
            sa.func.row_number().over(order_by=order).label("place"),
            failures.over(order_by=order, rows=until).label("failures"),
            sa.func.sum(episodes.c.wall_s).over(order_by=order, rows=until).label("worker_s"),
        )
        .where(episodes.c.campaign == campaign, _COMPLETED)
        .subquery()
        .c
    )
    every = max(1, ceil(completed / most))
    chosen = sa.or_(landed.place % every == 0, landed.place == completed)
    return sa.select(*landed).where(chosen).order_by(landed.place)


_SUMMED = tuple(episodes.c[name] for name in ENDED_COLUMNS)
"""An index holds just these."""


def count_results(connection: sa.Connection, chosen: Sequence[int]) -> dict[int, int]:
    """Count the results of campaigns, by id; campaigns that do not exist are left out."""
    query = sa.select(campaigns.c.id, campaigns.c.completed + campaigns.c.failed)
    found = connection.execute(query.where(campaigns.c.id.in_(chosen)))
    return {row[0]: row[1] for row in found}


def sum_campaigns(connection: sa.Connection, chosen: Sequence[int]) -> dict[int, records.Totals]:
    """Return sums over all failures, and episodes counted by class, of each campaign.

    `assess` defines the classes. The number of queries does not depend on the number of campaigns.
    """
    # In the order of an index: sums of floats depend on it, and reports must not change with it.
    failures = (
        sa.select(*_SUMMED, is_hopeless.label("hopeless"))
        .where(episodes.c.campaign.in_(chosen), is_failure)
        .order_by(episodes.c.campaign, episodes.c.outcome, episode_index)
        .subquery()
        .c
    )
    collided = failures.outcome == Outcome.COLLISION
    classified = sa.and_(collided, failures.collided_s.is_not(None))
    ttc_lead_s = failures.collided_s - failures.ttc_violated_s
    drac_lead_s = failures.collided_s - failures.drac_violated_s
    query = sa.select(
        failures.campaign,
        sa.func.count().label("failures"),
        sa.func.min(failures["index"]).label("first_failure"),
        sa.func.coalesce(sa.func.sum(failures.log_probability), 0.0).label("log_probability"),
        sa.func.coalesce(sa.func.sum(failures.steps), 0).label("steps"),
        sa.func.sum(failures.severity).label("severity"),
        sa.func.count().filter(sa.and_(classified, failures.hopeless)).label("unavoidable"),
        sa.func.count().filter(sa.and_(classified, ~failures.hopeless)).label("planner_failures"),
        sa.func.count().filter(sa.and_(collided, ~classified)).label("unclassified"),
        sa.func.coalesce(sa.func.sum(ttc_lead_s), 0.0).label("ttc_lead_s"),
        sa.func.count(ttc_lead_s).label("ttc_leads"),
        sa.func.coalesce(sa.func.sum(drac_lead_s), 0.0).label("drac_lead_s"),
        sa.func.count(drac_lead_s).label("drac_leads"),
    ).group_by(failures.campaign)
    failed = {found.campaign: found for found in connection.execute(query)}
    naming = _select_naming(chosen)
    is_near = (has_no_collision, episodes.c.min_ttc_s < records.NEAR_MISS_TTC_S)
    collided = episodes.c.collided_s.is_not(None)
    near = _count_by_campaign(connection, chosen, *is_near)
    # Collisions that no requirement forbids are no near misses. They are counted by themselves and
    # taken off, so that the index of the smallest times alone answers the question before.
    near.subtract(_count_by_campaign(connection, naming, *is_near, collided) if near else {})
    allowed = _count_by_campaign(connection, naming, episodes.c.outcome == Outcome.SAFE, collided)
    unresolved = _count_by_campaign(connection, chosen, is_unresolved)
    faults = _find_frequent_faults(connection, chosen)
    return {
        campaign: _to_totals(
            failed.get(campaign),
            records.ConflictTotals(
                near_misses=near[campaign],
                unresolved=unresolved[campaign],
                allowed=allowed[campaign],
            ),
            faults.get(campaign),
        )
        for campaign in chosen
    }


_OF_FAILURES = ("failures", "log_probability", "steps", "severity", "first_failure")
_OF_CLASSES = (
    "unavoidable",
    "planner_failures",
    "unclassified",
    "ttc_lead_s",
    "ttc_leads",
    "drac_lead_s",
    "drac_leads",
)


def _to_totals(
    found: sa.Row[*tuple[Any, ...]] | None,
    safe: records.ConflictTotals,
    fault: records.FrequentFault | None,
) -> records.Totals:
    if found is None:
        return records.Totals(0, 0.0, 0, None, safe, fault)
    classes = replace(safe, **{name: getattr(found, name) for name in _OF_CLASSES})
    sums = {name: getattr(found, name) for name in _OF_FAILURES}
    return records.Totals(conflicts=classes, fault=fault, **sums)


def _count_by_campaign(
    connection: sa.Connection,
    chosen: Sequence[int] | sa.Select[int],
    *where: sa.ColumnElement[bool],
) -> Counter[int]:
    """Count the episodes that meet all conditions by campaign."""
    query = (
        sa.select(episodes.c.campaign, sa.func.count())
        .where(episodes.c.campaign.in_(chosen), *where)
        .group_by(episodes.c.campaign)
    )
    return Counter({row[0]: row[1] for row in connection.execute(query)})


def _select_naming(chosen: Sequence[int]) -> sa.Select[int]:
    """Select the given campaigns that name requirements: only they can have allowed collisions."""
    return sa.select(campaigns.c.id).where(
        campaigns.c.id.in_(chosen), spec_field("requirements").is_not(None)
    )


def select_unresolved() -> sa.Select[int, int]:
    """Select the number of unresolved episodes of each campaign that has some."""
    return (
        sa.select(episodes.c.campaign, sa.func.count().label("unresolved"))
        .where(is_unresolved)
        .group_by(episodes.c.campaign)
    )


def _find_frequent_faults(
    connection: sa.Connection, chosen: Sequence[int]
) -> dict[int, records.FrequentFault]:
    """Return the most frequent fault of each campaign that has errored episodes.

    An index leads to the errored episodes; most campaigns have none.
    """
    reason = (episodes.c.campaign, episodes.c.fault_kind, episodes.c.fault_message)
    first, count = sa.func.min(episode_index), sa.func.count()
    rank = sa.func.row_number().over(
        partition_by=episodes.c.campaign, order_by=(count.desc(), first.asc())
    )
    ranked = (
        sa.select(*reason, count.label("n"), first.label("first"), rank.label("rank"))
        .where(episodes.c.campaign.in_(chosen), episodes.c.outcome == Outcome.ERRORED)
        .group_by(*reason)
        .subquery()
    )
    found = connection.execute(sa.select(ranked).where(ranked.c.rank == 1))
    return {
        row.campaign: records.FrequentFault(
            row.fault_kind or "", row.fault_message or "", row.n, row.first
        )
        for row in found
    }
