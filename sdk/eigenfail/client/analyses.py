"""Analyses, as a client sees them."""

from collections.abc import Iterator, Mapping
from typing import Any

from eigenfail.client.link import Link
from eigenfail.client.waiting import wait_until
from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    Campaign,
    FailureMode,
    Page,
)
from eigenfail.wire.http import ReplayRequest

OVER = frozenset({AnalysisState.DONE, AnalysisState.FAILED})
DEFAULTS = AnalysisSettings()


class Analyses:
    """Group the failures of campaigns, and replay what they have in common.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(self, campaign: int, settings: AnalysisSettings = DEFAULTS) -> Analysis:
        """A new analysis of a campaign's failures, queued.

        Raises:
            NotFound: no such campaign.
            InvalidValue: a setting outside its bounds.
        """
        return self._link.post(f"/campaigns/{campaign}/analyses", Analysis, settings)

    def get(self, analysis: int) -> Analysis:
        """The analysis, with its result once it is done.

        Raises:
            NotFound: no such analysis.
        """
        return self._link.get(f"/analyses/{analysis}", Analysis)

    def list(self, campaign: int) -> Iterator[Analysis]:
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

    def replay(
        self,
        analysis: int,
        scenario_parameters: Mapping[str, Any] | None = None,
        name: str | None = None,
    ) -> Campaign:
        """A new campaign that injects the eigenfailures, one episode each.

        Args:
            analysis: its id.
            scenario_parameters: put over those of the analysed campaign: a variation.
            name: of the new campaign; None makes one.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done, or found no failure mode.
            UnknownName: a parameter that the scenario does not have.
            InvalidValue: a parameter outside its bounds.
        """
        request = ReplayRequest(name=name, scenario_parameters=dict(scenario_parameters or {}))
        return self._link.post_once_only(f"/analyses/{analysis}/replay", Campaign, request)
