"""Analyses, as a client sees them, and the triage of their failure modes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack

from eigenfail.client.fields import AnalysisFields, refuse_fields_beside
from eigenfail.client.link import Link, wait_until
from eigenfail.client.references import (
    AnalysisLike,
    CampaignLike,
    ModeLike,
    locate_analysis,
    locate_campaign,
    locate_mode,
    split_text,
)
from eigenfail.contracts.recording import ANIMATION
from eigenfail.files import write_whole
from eigenfail.values.analysis import Analysis, AnalysisSettings, AnalysisState, FailureMode, Mode
from eigenfail.values.proof import Proof
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.values.triage import Triage, TriageChange, TriageState
from eigenfail.wire.http import ModeName, ProofRequest, read_fields

# A failed analysis is over: no wait may last until somebody makes another.
OVER = frozenset({AnalysisState.DONE, AnalysisState.FAILED})


class Analyses:
    """Group the failures of campaigns, and prove their common patterns by replay.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self,
        campaign: CampaignLike,
        settings: AnalysisSettings | None = None,
        **fields: Unpack[AnalysisFields],
    ) -> Analysis:
        """Queue and return a new analysis of a campaign's failures.

        Args:
            campaign: the campaign, or its id.
            settings: all settings; or give only those that differ from the defaults, by name.
            fields: fields of AnalysisSettings, as plain data.

        Raises:
            NotFound: no such campaign.
            UnknownName: a setting that does not exist.
            InvalidValue: a setting is outside its bounds, fields are given together with
                `settings`, or a further campaign does not exist or does not match this one.
        """
        refuse_fields_beside("settings", settings, fields)
        wanted = settings or read_fields(fields, AnalysisSettings)
        return self._link.post(f"{locate_campaign(campaign)}/analyses", Analysis, wanted)

    def get(self, analysis: AnalysisLike) -> Analysis:
        """Return the analysis, with its result once it is done.

        Raises:
            NotFound: no such analysis.
        """
        return self._link.get(locate_analysis(analysis), Analysis)

    def list(self, campaign: CampaignLike) -> Rows[Analysis]:
        """List the analyses of a campaign, newest first, without their results.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.pages(f"{locate_campaign(campaign)}/analyses", Page[Analysis], "before")

    def wait(
        self, analysis: AnalysisLike, poll_s: float = 0.3, timeout_s: float | None = None
    ) -> Analysis:
        """Wait until an analysis is done or has failed, and return it.

        Raises:
            NotFound: no such analysis.
            WaitTimeout: it did not end in time; it continues to run.
        """
        return wait_until(
            lambda: self.get(analysis),
            lambda seen: seen.state in OVER,
            poll_s,
            timeout_s,
            lambda seen: f"Analysis {seen.id} ({seen.state})",
        )

    def eigenfailures(self, analysis: AnalysisLike) -> tuple[FailureMode, ...]:
        """Return the failure modes, each with its eigenfailure.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"{locate_analysis(analysis)}/eigenfailures", Page[FailureMode]).items

    def modes(
        self,
        analysis: AnalysisLike,
        state: TriageState | str | None = None,
    ) -> tuple[Mode, ...]:
        """Return the failure modes by number, with their names and without their noise.

        Args:
            analysis: id of the analysis.
            state: only modes in this state of triage.

        Raises:
            NotFound: no such analysis.
            InvalidValue: unknown state.
        """
        path = f"{locate_analysis(analysis)}/modes"
        return self._link.get(path, Page[Mode], {"state": state}).items

    def rename_mode(
        self, analysis: AnalysisLike, mode: ModeLike | str | None = None, name: str | None = None
    ) -> Mode:
        """Give a failure mode a name.

        Args:
            analysis: the analysis, or its id; or the mode, as listed.
            mode: the mode, or its number, from 1; left out if `analysis` is the mode:
                `rename_mode(mode, "late braking")`.
            name: at most 80 characters.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: the name is missing, empty, too long, or cannot be printed.
        """
        number, given = split_text("name", mode, name)
        place = f"{locate_mode(analysis, number)}/name"
        return self._link.put(place, Mode, read_fields({"name": given}, ModeName))

    def animate(
        self,
        analysis: AnalysisLike,
        mode: ModeLike | Path | str | None = None,
        path: Path | str | None = None,
        format: str = ANIMATION,  # noqa: A002 - as for files elsewhere
    ) -> Path:
        """Write the failures of a mode, drawn over each other, as an animated GIF.

        Args:
            analysis: the analysis, or its id; or the mode, as listed.
            mode: the mode, or its number, from 1; left out if `analysis` is the mode:
                `animate(mode, "mode.gif")`.
            path: path of the file; an existing file is replaced.
            format: gif, or another one for which the service has a plug-in.

        Returns:
            The path.

        Raises:
            NotFound: no such analysis or mode.
            UnknownName: the service does not have this format.
            Conflict: the analysis is not done, or none of the failures has a scene.
            InvalidValue: the path is missing, or the service cannot write the format.
            ServiceError: the file cannot be written.
        """
        number, named = split_text("path", mode, path)
        file = Path(named)
        place = f"{locate_mode(analysis, number)}/animation"
        write_whole(file, self._link.chunks(place, {"format": format}))
        return file

    def prove(
        self, analysis: AnalysisLike, variations: Sequence[Mapping[str, Any]] | None = None
    ) -> Proof:
        """Have eigenfailures and medoids replayed, in a campaign for each scenario.

        Failures that were already replayed in a scenario are not replayed there again. Wait for the
        end with `wait_for_proof`.

        Args:
            analysis: the analysis, or its id.
            variations: scenario parameters, each replacing a parameter of the analysed campaign; {}
                is its own scenario. None takes its own scenario and the neighbours on both sides.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done, found no failure mode, or covers several worlds.
            UnknownName: a parameter that the scenario does not have.
            InvalidValue: a parameter outside its bounds, a distribution, or no variation.
        """
        asked = read_fields({"variations": variations}, ProofRequest)
        # The service finds replays that it has, so that a repeated request starts none twice.
        return self._link.post_once_only(f"{locate_analysis(analysis)}/proof", Proof, asked)

    def proof(self, analysis: AnalysisLike) -> Proof:
        """Return how many replays failed again so far, by scenario.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"{locate_analysis(analysis)}/proof", Proof)

    def wait_for_proof(
        self, analysis: AnalysisLike, poll_s: float = 0.3, timeout_s: float | None = None
    ) -> Proof:
        """Wait until all replays of a proof have ended, and return it; call `prove` first.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
            WaitTimeout: they did not end in time; they continue to run.
        """
        place = locate_analysis(analysis).removeprefix("/analyses/")
        return wait_until(
            lambda: self.proof(analysis),
            lambda seen: seen.done,
            poll_s,
            timeout_s,
            lambda _seen: f"The proof of analysis {place}",
        )


class TriageFields(TypedDict, total=False):
    """Fields of a change of triage; those that are left out do not change.

    Attributes:
        state: new, confirmed, known, fixed or not_a_bug.
        ticket: address of its ticket, beginning with https:// or http://; empty for none.
        note: the new note, which replaces the old one; empty for none.
    """

    state: TriageState | str
    ticket: str
    note: str


class TriageRecords:
    """Read and change the triage of failure modes.

    Changes need a key of the scope runner if keys are required. Every method raises
    InvalidValue for a value of the wrong kind, and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def get_mode(self, analysis: AnalysisLike, mode: ModeLike | None = None) -> Triage:
        """Return the triage of a failure mode.

        Args:
            analysis: the analysis, or its id; or the mode, as listed.
            mode: the mode, or its number, from 1; left out if `analysis` is the mode.

        Raises:
            NotFound: no such analysis or mode.
        """
        return self._link.get(f"{locate_mode(analysis, mode)}/triage", Triage)

    def change_mode(
        self, analysis: AnalysisLike, mode: ModeLike | None = None, **fields: Unpack[TriageFields]
    ) -> Triage:
        """Change the triage of a failure mode, and return it.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: a value is outside its bounds, or the ticket is not an address.
        """
        change = read_fields(fields, TriageChange)
        return self._link.post(f"{locate_mode(analysis, mode)}/triage", Triage, change)
