"""Minimal: which steps of which axis, and how strong, a failure needs."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.values import (
    EpisodeResult,
    Floats,
    LearnerContext,
    Outcome,
    Proposal,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.minimal.search import (
    NOT_RUN,
    SAFE,
    Phase,
    Search,
    after,
    candidates,
    start,
)

Id = Annotated[int, msgspec.Meta(ge=1)]


class MinimalSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `minimal`: name an episode of a campaign, or a mode of an analysis."""

    campaign: Annotated[
        Id | None, msgspec.Meta(description="shrink a failure of this campaign")
    ] = None
    episode: Annotated[
        Annotated[int, msgspec.Meta(ge=0)] | None,
        msgspec.Meta(description="of that campaign; it ended in a collision"),
    ] = None
    analysis: Annotated[
        Id | None, msgspec.Meta(description="shrink an eigenfailure of this analysis")
    ] = None
    mode: Annotated[Id | None, msgspec.Meta(description="of that analysis, counted from 1")] = None
    round_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="replays in a round at most")
    ] = 500


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is known, beside the noise itself.

    Attributes:
        ends: of the candidates of this phase that were tried.
        tried: replays before this phase.
        best: the replay that showed the noise to fail; None before there is one. With a campaign of
            its own, that is the index of its episode.
    """

    phase: Phase
    width: Annotated[int, msgspec.Meta(ge=1)]
    removable: tuple[int, ...]
    low: float
    high: float
    scaled: bool
    not_run: int
    ends: tuple[int, ...]
    tried: int
    best: int | None


class Minimal:
    """Shrinks one failure, see `search`; ends when nothing more can be left out.

    Everything is decided by what was found: no random draws.

    Args:
        context: its one trajectory is the failure.
        settings: say where it came from.

    Raises:
        InvalidValue: there is not exactly one trajectory.

    Attributes:
        lookahead: none: what is tried next depends on all that was tried.
    """

    Settings = MinimalSettings

    lookahead = 0

    def __init__(self, context: LearnerContext, settings: MinimalSettings) -> None:
        if len(context.trajectories) != 1:
            raise InvalidValue(
                "settings",
                f"they name {len(context.trajectories)} failures to be shrunk, not one.",
                "Name a campaign and an episode of it, or an analysis and a mode of it.",
            )
        self._round_size = settings.round_size
        self._search = start(np.ascontiguousarray(context.trajectories[0], np.float32))
        self._ends: tuple[int, ...] = ()

    def propose(self, n: int) -> Proposal:
        """The next candidates of this phase; none once the search is over."""
        first = len(self._ends)
        tried = candidates(self._search)[first : first + min(n, self._round_size)]
        return Proposal(tuple(TrajectorySource(z) for z in tried))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep how each ended; after the last candidate of a phase, decide.

        Raises:
            LearnerFailed: the failure does not reproduce at full strength.
        """
        if self._search.phase is Phase.FULL:
            for result in results:
                refuse_harmless(result)
        self._ends += tuple(map(end_of, results))
        if len(self._ends) == len(candidates(self._search)):
            self._search, self._ends = after(self._search, self._ends), ()

    def state(self) -> bytes:
        """Where the search stands."""
        search = self._search
        facts = Facts(
            phase=search.phase,
            width=search.width,
            removable=search.removable,
            low=search.low,
            high=search.high,
            scaled=search.scaled,
            not_run=search.not_run,
            ends=self._ends,
            tried=search.tried,
            best=search.best,
        )
        return archive.write("minimal", facts, {"z": search.z})

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("minimal", state, Facts)
        with archive.refusing("minimal"):
            z = archive.take(arrays, "z", self._search.z.shape)
        self._search = Search(
            facts.phase,
            z,
            facts.width,
            facts.removable,
            facts.low,
            facts.high,
            facts.scaled,
            facts.not_run,
            facts.tried,
            facts.best,
        )
        self._ends = facts.ends


def end_of(result: EpisodeResult) -> int:
    """The step after which it failed, `SAFE`, or `NOT_RUN`."""
    return {Outcome.COLLISION: result.steps, Outcome.FAILED: NOT_RUN}.get(result.outcome, SAFE)


def refuse_harmless(result: EpisodeResult) -> None:
    """Make sure that the failure is one.

    Raises:
        LearnerFailed: its replay ended without a collision.
    """
    if result.outcome is not Outcome.SAFE:
        return
    nearest = f"{result.measures.robustness_m:.2f} m" if result.measures else "something"
    raise LearnerFailed(
        f"The failure does not reproduce at full strength: its replay stayed {nearest} from a "
        "collision, so there is nothing to shrink.",
        "Shrink it in the scenario, and with the planner and the noise, of its own campaign.",
    )


def known(state: bytes) -> tuple[Facts, Floats]:
    """What a learner of this method knew, and the noise it came down to, shape (steps, 2).

    Raises:
        ProtocolError: the bytes are not a state of this method.
    """
    facts, arrays = archive.read("minimal", state, Facts)
    with archive.refusing("minimal"):
        return facts, arrays["z"]
