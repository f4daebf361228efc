"""Analyses, their results with the triage of each mode, and the campaigns that replay them."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from msgspec import Struct
from msgspec.structs import asdict
from sqlalchemy import Connection, Table, insert, select, update

from eigenfail.presentation.figures import count_noun
from eigenfail.values.analysis import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    AnalysisState,
    Mode,
)
from eigenfail.values.records import JobKind, Page
from eigenfail.values.triage import Triage, TriageChange, TriageState, change_triage
from eigenfail_services.store import codec
from eigenfail_services.store.campaign_rows import lock_campaign, read_campaign
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.errors import make_analysis_error, make_mode_error
from eigenfail_services.store.events import EventSubject, append_event
from eigenfail_services.store.jobs import enqueue
from eigenfail_services.store.judging import keep_finite
from eigenfail_services.store.listing import contains_text
from eigenfail_services.store.retention import UNFINISHED, hold_noise
from eigenfail_services.store.schema import (
    analyses,
    mode_members,
    modes,
    replays,
    select_newest_analysis,
)

Read = TypeVar("Read", bound=Struct)

_PARSERS: dict[str, Callable[[Any], Any]] = {
    "settings": codec.to_settings,
    "result": codec.to_analysis_result,
}
_WHOLE = codec.StructRows(analyses, Analysis, _PARSERS)
# Results have megabytes: lists of analyses do not read them.
_BRIEF = codec.StructRows(analyses, Analysis, _PARSERS, without=("result",))
_MODE = codec.StructRows(modes, Mode)
_MODES = select(*_MODE.columns).order_by(modes.c.number)
# A mode and its triage lie in one row.
_TRIAGE = codec.StructRows(modes, Triage)


class AnalysisStore(StorePart):
    """Analyses; the first end of each is final, and later ones change nothing."""

    def create(self, campaign: int, settings: AnalysisSettings) -> Analysis:
        """Create an analysis, queued with a job for it.

        Raises:
            NotFound: no such campaign.
        """
        statement = (
            insert(analyses)
            .values(
                campaign=campaign,
                settings=codec.to_json(settings),
                state=AnalysisState.QUEUED,
                created_ms=now_ms(),
                problem="",
            )
            .returning(*_BRIEF.columns)
        )
        with self._database.writing() as connection:
            # A pruning that runs at the same time would delete noise that this analysis is about to
            # read.
            hold_noise(connection, [campaign])
            read_campaign(connection, campaign)
            (analysis,) = _BRIEF.list(connection, statement)
            enqueue(connection, JobKind.ANALYSIS, analysis.id)
            _log(connection, analysis)
        return analysis

    def get(self, analysis: int) -> Analysis:
        """Return an analysis with its result.

        Raises:
            NotFound: no such analysis.
        """
        query = select(*_WHOLE.columns).where(analyses.c.id == analysis)
        with self._database.reading() as connection:
            found = _WHOLE.first(connection, query)
        if found is None:
            raise make_analysis_error(analysis)
        return found

    def page(
        self, limit: int, before: int | None = None, campaign: int | None = None
    ) -> Page[Analysis]:
        """Return analyses, newest first, with ids below `before`, without their results."""
        where = () if campaign is None else (analyses.c.campaign == campaign,)
        return self._database.read(_BRIEF.page, limit, before, *where)

    def start(self, analysis: int) -> None:
        """Mark an analysis as running."""
        with self._database.writing() as connection:
            _change(connection, analysis, {"state": AnalysisState.RUNNING})

    def finish(self, analysis: int, result: AnalysisResult) -> None:
        """Store the result of an analysis, and mark it as done."""
        columns = {
            "state": AnalysisState.DONE,
            "failures": len(result.episodes),
            "modes": len(result.modes),
            "silhouette": keep_finite(result.silhouette),
            "noise_silhouette": keep_finite(result.noise_silhouette),
            "result": codec.pack(result),
        }
        with self._database.writing() as connection:
            # The modes are inserted in the same transaction: no reader sees a finished analysis
            # without its modes.
            if ended := _change(connection, analysis, columns):
                _insert_modes(connection, ended, result)

    def fail(self, analysis: int, problem: str) -> None:
        """Mark an analysis as failed, with the reason."""
        with self._database.writing() as connection:
            give_up(connection, analysis, problem)

    def modes(self, analysis: int, state: TriageState | None = None) -> tuple[Mode, ...]:
        """Return the modes of an analysis by number; none before it is done.

        Args:
            analysis: id of the analysis.
            state: only those in this state of triage; None for all.

        Raises:
            NotFound: no such analysis.
        """
        with self._database.reading() as connection:
            _require_analysis(connection, analysis)
            query = _MODES.where(modes.c.analysis == analysis)
            return _MODE.list(
                connection, query if state is None else query.where(modes.c.state == state)
            )

    def mode(self, analysis: int, number: int) -> Mode:
        """Return a mode of an analysis.

        Raises:
            NotFound: no such analysis or mode.
        """
        return self._database.read(_read_of_mode, _MODE, analysis, number)

    def rename_mode(self, analysis: int, number: int, name: str) -> Mode:
        """Give a mode of an analysis a name, and return it.

        Raises:
            NotFound: no such analysis or mode.
        """
        place = modes.c.analysis == analysis, modes.c.number == number
        with self._database.writing() as connection:
            connection.execute(update(modes).where(*place).values(name=name))
            return _read_of_mode(connection, _MODE, analysis, number)

    def get_triage(self, analysis: int, number: int) -> Triage:
        """Return the triage of a mode of an analysis.

        Raises:
            NotFound: no such analysis or mode.
        """
        return self._database.read(_read_of_mode, _TRIAGE, analysis, number)

    def change_triage(
        self,
        analysis: int,
        number: int,
        change: TriageChange,
        who: str,
        check: Callable[[Triage], None] = lambda _triage: None,
    ) -> Triage:
        """Change the triage of a mode, and return it.

        Args:
            analysis: id of the analysis.
            number: number of the mode, from 1.
            change: what changes.
            who: name of who makes the change.
            check: raises an error if the current triage is not the one to be changed; no other
                change comes between.

        Raises:
            NotFound: no such analysis or mode.
        """
        with self._database.writing() as connection:
            before = _read_of_mode(connection, _TRIAGE, analysis, number, lock=True)
            check(before)
            after = change_triage(before, change, now_ms(), who)
            place = modes.c.analysis == analysis, modes.c.number == number
            connection.execute(update(modes).where(*place).values(asdict(after)))
        return after

    def find_modes(self, campaign: int, index: int) -> tuple[Mode, ...]:
        """Return the modes that an episode belongs to, of the newest analysis first."""
        member = mode_members.c
        same = (member.analysis == modes.c.analysis) & (member.number == modes.c.number)
        query = (
            select(*_MODE.columns)
            .select_from(modes.join(mode_members, same))
            .where(member.campaign == campaign, member["index"] == index)
            .order_by(modes.c.analysis.desc())
        )
        return self._database.read(_MODE.list, query)

    def search_modes(self, text: str, limit: int) -> tuple[Mode, ...]:
        """Return modes whose names contain a text in small or large letters, newest first."""
        matching = contains_text(modes.c.name, text)
        query = (
            select(*_MODE.columns)
            .where(matching)
            .order_by(modes.c.analysis.desc(), modes.c.number)
            .limit(limit)
        )
        return self._database.read(_MODE.list, query)

    def find_newest(self, campaign: int) -> int | None:
        """Return the id of the newest analysis of a campaign that has a mode; None without one."""
        with self._database.reading() as connection:
            found: int | None = connection.execute(select_newest_analysis(campaign)).scalar()
        return found

    def link_replay(self, analysis: int, campaign: int) -> None:
        """Link a campaign that replays an analysis's failures; a known link changes nothing.

        Raises:
            NotFound: no such analysis or campaign.
        """
        link = {"analysis": analysis, "campaign": campaign}
        with self._database.writing() as connection:
            # Two requests that add one link run one after the other; without the lock neither would
            # find the link of the other.
            lock_campaign(connection, campaign)
            if campaign not in _replays(connection, analysis):
                connection.execute(insert(replays).values(link))

    def replays(self, analysis: int) -> tuple[int, ...]:
        """Return the campaigns that replay an analysis's failures, oldest first.

        Raises:
            NotFound: no such analysis.
        """
        return self._database.read(_replays, analysis)


def give_up(connection: Connection, analysis: int, problem: str) -> None:
    """Mark an analysis as failed, unless it has ended."""
    _change(connection, analysis, {"state": AnalysisState.FAILED, "problem": problem})


def _change(connection: Connection, analysis: int, columns: Mapping[str, Any]) -> Analysis | None:
    """Change an analysis that has not ended, and return it; None if the analysis has ended.

    Raises:
        NotFound: no such analysis.
    """
    statement = (
        update(analyses)
        # The state is part of the statement: if two processes end one analysis, only the first
        # finds a row.
        .where(analyses.c.id == analysis, analyses.c.state.in_(UNFINISHED))
        .values(**columns)
        # The result is returned as well, because the event says how many modes there are.
        .returning(*_WHOLE.columns)
    )
    after = _WHOLE.first(connection, statement)
    if after is None:
        _require_analysis(connection, analysis)
        return None
    _log(connection, after)
    return after


def _insert_modes(connection: Connection, analysis: Analysis, result: AnalysisResult) -> None:
    """Insert the modes of a result, and the failures that belong to them."""
    rows: tuple[tuple[Table, list[dict[str, Any]]], ...] = (
        (modes, [asdict(mode) for mode in result.list_modes(analysis.id)]),
        (
            mode_members,
            [
                {"campaign": owner, "analysis": analysis.id, "index": index, "number": number}
                for owner, index, number in result.list_members(analysis.campaign)
            ],
        ),
    )
    for table, inserted in rows:
        if inserted:
            connection.execute(insert(table), inserted)


def _read_of_mode(
    connection: Connection,
    rows: codec.StructRows[Read],
    analysis: int,
    number: int,
    *,
    lock: bool = False,
) -> Read:
    """Return the values in the row of a mode.

    Raises:
        NotFound: no such analysis or mode.
    """
    query = select(*rows.columns).where(modes.c.analysis == analysis, modes.c.number == number)
    # Changes of one mode come one after the other: each sees what the one before has written.
    found = rows.first(connection, query.with_for_update() if lock else query)
    if found is None:
        _require_analysis(connection, analysis)
        raise make_mode_error(analysis, number)
    return found


def _require_analysis(connection: Connection, analysis: int) -> None:
    """Raise NotFound if the analysis does not exist."""
    if connection.execute(select(analyses.c.id).where(analyses.c.id == analysis)).first() is None:
        raise make_analysis_error(analysis)


def _replays(connection: Connection, analysis: int) -> tuple[int, ...]:
    _require_analysis(connection, analysis)
    linked = select(replays.c.campaign).where(replays.c.analysis == analysis)
    return tuple(connection.execute(linked.order_by(replays.c.campaign)).scalars())


def _log(connection: Connection, analysis: Analysis) -> None:
    """Log the new state of an analysis."""
    result = analysis.result
    findings = (
        f": {count_noun(len(result.modes), result.cluster_noun)} in "
        f"{count_noun(len(result.episodes), 'failure')}"
        if result
        else ""
    )
    phrases = {
        AnalysisState.QUEUED: "waits in the queue",
        AnalysisState.RUNNING: "is running",
        AnalysisState.DONE: f"is done{findings}",
        AnalysisState.FAILED: "failed",
    }
    phrase = f"Analysis {analysis.id} of campaign {analysis.campaign} {phrases[analysis.state]}."
    message = f"{phrase} {analysis.problem}".strip()
    subject = EventSubject(analysis.id, analysis.state)
    append_event(connection, "analysis.state", message, analysis.campaign, subject)
