"""Analyses, as a client sees them."""

from collections.abc import Mapping, Sequence
from typing import Any

from eigenfail.client.link import Link
from eigenfail.client.waiting import wait_until
from eigenfail.rows import Rows
from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
    Page,
    Proof,
)
from eigenfail.wire.http import ProofRequest, read_fields

OVER = frozenset({AnalysisState.DONE, AnalysisState.FAILED})


class Analyses:
    """Group the failures of campaigns, and prove by replay what they have in common.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self, campaign: int, settings: AnalysisSettings | None = None, **fields: Any
    ) -> Analysis:
        """A new analysis of a campaign's failures, queued.

        Args:
            campaign: its id.
            settings: all of them; or give those that are not as usual by name.
            fields: of AnalysisSettings, as plain data.

        Raises:
            NotFound: no such campaign.
            UnknownName: a setting that does not exist.
            InvalidValue: a setting outside its bounds, or further campaigns that are not there or
                do not go together with this one.
        """
        wanted = settings or read_fields(fields, AnalysisSettings)
        return self._link.post(f"/campaigns/{campaign}/analyses", Analysis, wanted)

    def get(self, analysis: int) -> Analysis:
        """The analysis, with its result once it is done.

        Raises:
            NotFound: no such analysis.
        """
        return self._link.get(f"/analyses/{analysis}", Analysis)

    def list(self, campaign: int) -> Rows[Analysis]:
        """The analyses of a campaign, newest first, without their results.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.pages(f"/campaigns/{campaign}/analyses", Page[Analysis], "before")

    def wait(self, analysis: int, poll_s: float = 0.3, timeout_s: float | None = None) -> Analysis:
        """The analysis once it is done or has failed.

        Raises:
            NotFound: no such analysis.
            ServiceError: it is not over in time; it goes on all the same.
        """
        return wait_until(
            lambda: self.get(analysis), lambda seen: seen.state in OVER, poll_s, timeout_s
        )

    def eigenfailures(self, analysis: int) -> tuple[FailureMode, ...]:
        """The failure modes, each with its eigenfailure.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"/analyses/{analysis}/eigenfailures", Page[FailureMode]).items

    def prove(self, analysis: int, variations: Sequence[Mapping[str, Any]] | None = None) -> Proof:
        """Have eigenfailures and medoids replayed, in a campaign for each scenario.

        What is replayed there already is not replayed again. Wait for the end with
        `wait_for_proof`.

        Args:
            analysis: its id.
            variations: scenario parameters, each put over those of the analysed campaign, {} for
                its own scenario; None takes that and its neighbours to both sides.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done, found no failure mode, or is of several worlds.
            UnknownName: a parameter that the scenario does not have.
            InvalidValue: a parameter outside its bounds, a distribution, or no variation.
        """
        asked = read_fields({"variations": variations}, ProofRequest)
        return self._link.post_once_only(f"/analyses/{analysis}/proof", Proof, asked)

    def proof(self, analysis: int) -> Proof:
        """How many replays failed again, in which scenarios, as far as results are in.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"/analyses/{analysis}/proof", Proof)

    def wait_for_proof(
        self, analysis: int, poll_s: float = 0.3, timeout_s: float | None = None
    ) -> Proof:
        """The proof once all of its replays have ended; `prove` comes first.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
            ServiceError: they have not ended in time; they go on all the same.
        """
        return wait_until(lambda: self.proof(analysis), lambda seen: seen.done, poll_s, timeout_s)
