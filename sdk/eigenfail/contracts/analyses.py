"""What remembers analyses."""

from typing import Protocol

from eigenfail.values import Analysis, AnalysisResult, AnalysisSettings, Page


class AnalysisStore(Protocol):
    """Analyses and what they found."""

    def create(self, campaign: int, settings: AnalysisSettings) -> Analysis:
        """A new analysis, queued with a job for it.

        Raises:
            NotFound: no such campaign.
        """

    def get(self, analysis: int) -> Analysis:
        """The analysis as it stands.

        Raises:
            NotFound: no such analysis.
        """

    def page(
        self, limit: int, before: int | None = None, campaign: int | None = None
    ) -> Page[Analysis]:
        """Analyses, newest first, with ids below `before`, without their results."""

    def start(self, analysis: int) -> None:
        """It is running now."""

    def finish(self, analysis: int, result: AnalysisResult) -> None:
        """It is done."""

    def fail(self, analysis: int, problem: str) -> None:
        """It cannot be done."""

    def link_replay(self, analysis: int, campaign: int) -> None:
        """Remember a campaign that replays what it found; nothing new if it is known.

        Raises:
            NotFound: no such analysis or campaign.
        """

    def replays(self, analysis: int) -> tuple[int, ...]:
        """The campaigns that replay what it found, oldest first.

        Raises:
            NotFound: no such analysis.
        """
