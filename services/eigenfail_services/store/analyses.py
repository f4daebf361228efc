"""Analyses and what they found, in SQL."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, RowMapping, insert, select, update

from eigenfail.values import Analysis, AnalysisResult, AnalysisSettings, AnalysisState, Page
from eigenfail.values.records import JobKind
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import locked, one
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import pack, to_analysis_result, to_json, to_settings
from eigenfail_services.store.engine import Database
from eigenfail_services.store.events import append
from eigenfail_services.store.jobs import enqueue
from eigenfail_services.store.judging import finite
from eigenfail_services.store.naming import hold_noise
from eigenfail_services.store.refusals import no_analysis
from eigenfail_services.store.schema import analyses, replays

UNFINISHED = (AnalysisState.QUEUED, AnalysisState.RUNNING)

BRIEF = (
    analyses.c.id,
    analyses.c.campaign,
    analyses.c.settings,
    analyses.c.state,
    analyses.c.created_ms,
    analyses.c.problem,
)


class SqlAnalyses:
    """Analyses; the first end of each counts, and whoever comes later changes nothing."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, campaign: int, settings: AnalysisSettings) -> Analysis:
        """A new analysis, queued with a job for it."""
        statement = (
            insert(analyses)
            .values(
                campaign=campaign,
                settings=to_json(settings),
                state=AnalysisState.QUEUED,
                created_ms=now_ms(),
                problem="",
            )
            .returning(*BRIEF)
        )
        with self._database.writing() as connection:
            hold_noise(connection, [campaign])
            one(connection, campaign)
            analysis = _analysis(connection.execute(statement).mappings().one())
            enqueue(connection, JobKind.ANALYSIS, analysis.id)
            _log(connection, analysis)
        return analysis

    def get(self, analysis: int) -> Analysis:
        """The analysis as it stands."""
        query = select(*BRIEF, analyses.c.result).where(analyses.c.id == analysis)
        with self._database.reading() as connection:
            found = connection.execute(query).mappings().one_or_none()
        if found is None:
            raise no_analysis(analysis)
        return _analysis(found)

    def page(
        self, limit: int, before: int | None = None, campaign: int | None = None
    ) -> Page[Analysis]:
        """Analyses, newest first, with ids below `before`, without their results."""
        query = select(*BRIEF).order_by(analyses.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(analyses.c.id < before)
        if campaign is not None:
            query = query.where(analyses.c.campaign == campaign)
        with self._database.reading() as connection:
            found = [_analysis(row) for row in connection.execute(query).mappings()]
        items = tuple(found[:limit])
        return Page(items, items[-1].id if len(found) > limit else None)

    def start(self, analysis: int) -> None:
        """It is running now."""
        with self._database.writing() as connection:
            _change(connection, analysis, {"state": AnalysisState.RUNNING})

    def finish(self, analysis: int, result: AnalysisResult) -> None:
        """It is done."""
        columns = {
            "state": AnalysisState.DONE,
            "failures": len(result.episodes),
            "modes": len(result.modes),
            "silhouette": finite(result.silhouette),
            "noise_silhouette": finite(result.noise_silhouette),
            "result": pack(result),
        }
        with self._database.writing() as connection:
            _change(connection, analysis, columns)

    def fail(self, analysis: int, problem: str) -> None:
        """It cannot be done."""
        with self._database.writing() as connection:
            give_up(connection, analysis, problem)

    def link_replay(self, analysis: int, campaign: int) -> None:
        """Remember a campaign that replays what it found."""
        link = {"analysis": analysis, "campaign": campaign}
        with self._database.writing() as connection:
            locked(connection, campaign)
            if campaign not in _replays(connection, analysis):
                connection.execute(insert(replays).values(link))

    def replays(self, analysis: int) -> tuple[int, ...]:
        """The campaigns that replay what it found, oldest first."""
        with self._database.reading() as connection:
            return _replays(connection, analysis)


def give_up(connection: Connection, analysis: int, problem: str) -> None:
    """Let an analysis fail, unless it has ended."""
    _change(connection, analysis, {"state": AnalysisState.FAILED, "problem": problem})


def _change(connection: Connection, analysis: int, columns: Mapping[str, Any]) -> None:
    statement = (
        update(analyses)
        .where(analyses.c.id == analysis, analyses.c.state.in_(UNFINISHED))
        .values(**columns)
        .returning(*BRIEF, analyses.c.result)
    )
    changed = connection.execute(statement).mappings().one_or_none()
    if changed is not None:
        _log(connection, _analysis(changed))
        return
    if connection.execute(select(analyses.c.id).where(analyses.c.id == analysis)).first() is None:
        raise no_analysis(analysis)


def _replays(connection: Connection, analysis: int) -> tuple[int, ...]:
    if connection.execute(select(analyses.c.id).where(analyses.c.id == analysis)).first() is None:
        raise no_analysis(analysis)
    linked = select(replays.c.campaign).where(replays.c.analysis == analysis)
    return tuple(connection.execute(linked.order_by(replays.c.campaign)).scalars())


def _log(connection: Connection, analysis: Analysis) -> None:
    append(connection, "analysis.state", sentences.analysis_moved(analysis), analysis.campaign)


def _analysis(found: RowMapping) -> Analysis:
    values: dict[str, Any] = dict(found)
    result = values.pop("result", None)
    return Analysis(
        settings=to_settings(values.pop("settings")),
        state=AnalysisState(values.pop("state")),
        result=None if result is None else to_analysis_result(result),
        **values,
    )
