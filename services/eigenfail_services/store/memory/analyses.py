"""Analyses in memory."""

from typing import Any

from msgspec.structs import replace

from eigenfail.values import Analysis, AnalysisResult, AnalysisSettings, AnalysisState, Page
from eigenfail.values.records import JobKind
from eigenfail_services.store import sentences
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.memory.tables import Tables

UNFINISHED = frozenset({AnalysisState.QUEUED, AnalysisState.RUNNING})


class MemoryAnalyses:
    """Analyses; the first end of each counts, and whoever comes later changes nothing."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def create(self, campaign: int, settings: AnalysisSettings) -> Analysis:
        """A new analysis, queued with a job for it."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            number = len(self._tables.analyses) + 1
            analysis = Analysis(number, campaign, settings, AnalysisState.QUEUED, now_ms())
            self._tables.enqueue(JobKind.ANALYSIS, number)
            self._keep(analysis)
        return analysis

    def get(self, analysis: int) -> Analysis:
        """The analysis as it stands."""
        with self._tables.lock:
            return self._tables.analysis(analysis)

    def page(
        self, limit: int, before: int | None = None, campaign: int | None = None
    ) -> Page[Analysis]:
        """Analyses, newest first, with ids below `before`, without their results."""
        with self._tables.lock:
            found = [
                replace(analysis, result=None)
                for number, analysis in reversed(self._tables.analyses.items())
                if (before is None or number < before) and campaign in {None, analysis.campaign}
            ]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)

    def start(self, analysis: int) -> None:
        """It is running now."""
        self._change(analysis, state=AnalysisState.RUNNING)

    def finish(self, analysis: int, result: AnalysisResult) -> None:
        """It is done."""
        self._change(analysis, state=AnalysisState.DONE, result=result)

    def fail(self, analysis: int, problem: str) -> None:
        """It cannot be done."""
        self._change(analysis, state=AnalysisState.FAILED, problem=problem)

    def link_replay(self, analysis: int, campaign: int) -> None:
        """Remember a campaign that replays what it found."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            self._tables.analysis(analysis)
            self._tables.replays.setdefault(analysis, set()).add(campaign)

    def replays(self, analysis: int) -> tuple[int, ...]:
        """The campaigns that replay what it found, oldest first."""
        with self._tables.lock:
            self._tables.analysis(analysis)
            return tuple(sorted(self._tables.replays.get(analysis, ())))

    def _change(self, analysis: int, **changes: Any) -> None:
        with self._tables.lock:
            before = self._tables.analysis(analysis)
            if before.state in UNFINISHED:
                self._keep(replace(before, **changes))

    def _keep(self, analysis: Analysis) -> None:
        self._tables.analyses[analysis.id] = analysis
        message = sentences.analysis_moved(analysis)
        self._tables.log("analysis.state", message, analysis.campaign)
