"""What was found of episodes, and of campaigns that were run again."""

from enum import StrEnum

import msgspec

from eigenfail.gate.verdicts import Verdict
from eigenfail.values import Difference
from eigenfail.values.records import EpisodeRow

INDEPENDENT = frozenset({"monte_carlo"})
"""Methods whose failures are independent draws. Those of a search follow each other, so that two
searches of one planner may dwell in different failure modes."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """An episode of the new planner, and what became of it.

    Attributes:
        what: was injected, in words.
        was: the baseline's episode, as CAMPAIGN/INDEX; empty where there is none.
        episode: the new planner's, as CAMPAIGN/INDEX; empty if it was never run.
        replay: the command that runs it again.
        link: its page.
        problem: why it could not be run; empty otherwise.
        wall_s: what it took [s].
    """

    verdict: Verdict
    what: str
    was: str = ""
    episode: str = ""
    replay: str = ""
    link: str = ""
    problem: str = ""
    wall_s: float = 0.0


class By(StrEnum):
    """By what campaigns under the same noise are judged.

    `episode`: each episode that fails and did not is new. `rate`: they are new together, where more
    of them fail newly than no longer, by more than chance.
    """

    EPISODE = "episode"
    RATE = "rate"


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """What a campaign found, in numbers."""

    campaign: int
    completed: int
    failures: int
    failed: int


class Rerun(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that was run again with the new planner.

    Attributes:
        before: the baseline's.
        now: the new planner's.
        method: how both chose their noise.
        verdict: of all of it.
        by: whether its episodes count one by one, or all of it together.
        words: what it rests on, in a sentence.
        unpaired_because: why episodes cannot be held against each other one by one; empty where
            they were.
        counts: how many failing episodes there are of each verdict; empty where unpaired.
        findings: some of them, the new ones first; where unpaired, the likeliest failures.
        difference: of the failure rates; None before both completed an episode.
        modes: whether a failure mode is new, in a sentence; empty where that was not asked.
        new_modes: a failure of each mode that is new, the one nearest to its centre; they count
            only where `judges_modes`.
        warnings: what keeps the comparison from saying more.
        wall_s: how long it was running [s].
    """

    before: Figures
    now: Figures
    method: str
    verdict: Verdict
    by: By
    words: str
    unpaired_because: str = ""
    counts: dict[Verdict, int] = {}
    findings: tuple[Finding, ...] = ()
    difference: Difference | None = None
    modes: str = ""
    new_modes: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()
    wall_s: float = 0.0

    @property
    def told(self) -> str:
        """What it rests on, and what was found of its modes."""
        return f"{self.words} {self.modes}".rstrip()

    @property
    def judges_modes(self) -> bool:
        """Whether a new mode closes the gate: where failures are independent of each other."""
        return self.method in INDEPENDENT


def finding(found: Verdict, what: str, was: str, row: EpisodeRow | None, pages: str) -> Finding:
    """What became of one episode.

    Args:
        found: the verdict.
        what: was injected.
        was: the baseline's episode.
        row: of the new planner; None if it was never run.
        pages: address of the service's pages.
    """
    if row is None:
        return Finding(verdict=found, what=what, was=was, problem="It was never run.")
    episode = f"{row.campaign}/{row.index}"
    return Finding(
        verdict=found,
        what=what,
        was=was,
        episode=episode,
        replay=f"eigenfail episode replay {episode}",
        link=f"{pages}/campaigns/{row.campaign}/episodes/{row.index}",
        problem=row.problem,
        wall_s=row.wall_s,
    )
