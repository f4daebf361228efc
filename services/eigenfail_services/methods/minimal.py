"""Minimal failures: replays of a failure with less and less noise."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta, structs

from eigenfail.contracts import Injection, MethodTraits, Reference
from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.learning import LearnerContext, Proposal
from eigenfail_services.methods import Id, RoundSize, archive, minimal_search


class MinimalSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `minimal`: name an episode of a campaign, or a mode of an analysis."""

    campaign: Annotated[Id | None, Meta(description="shrink a failure of this campaign")] = None
    episode: Annotated[
        Annotated[int, Meta(ge=0)] | None,
        Meta(description="of that campaign; it ended in a collision"),
    ] = None
    analysis: Annotated[Id | None, Meta(description="shrink an eigenfailure of this analysis")] = (
        None
    )
    mode: Annotated[Id | None, Meta(description="of that analysis, counted from 1")] = None
    round_size: RoundSize = 500


class MinimalFacts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """State of a search besides its noise.

    Attributes:
        ends: ends of the tried candidates of this phase.
        tried: number of replays before this phase.
        best: number of the replay that failed with this noise, equal to its episode's index in the
            campaign; None before the first failure.
    """

    phase: minimal_search.SearchPhase
    width: Annotated[int, Meta(ge=1)]
    removable: tuple[int, ...]
    low: float
    high: float
    scaled: bool
    not_run: int
    ends: tuple[int, ...]
    tried: int
    best: int | None


class Minimal:
    """Shrinks one failure as `search` describes, until no more noise can be removed.

    The search is deterministic, without random draws.

    Args:
        context: context whose only trajectory is the failure.
        settings: settings with the source of the failure.

    Raises:
        InvalidValue: there is not exactly one trajectory.

    Attributes:
        lookahead: 0, as each phase depends on the results of the phase before.
    """

    Settings = MinimalSettings

    traits = MethodTraits(
        learns=False,
        finds_new=False,
        is_evidence=True,
        injects=Injection.ONE_FAILURE,
        chart_mark=6,
        references={"analysis": Reference.NOISE, "campaign": Reference.NOISE},
    )
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: MinimalSettings) -> None:
        if len(context.trajectories) != 1:
            raise InvalidValue(
                "settings",
                f"they name {len(context.trajectories)} failures to be shrunk, not one.",
                "Name a campaign and an episode of it, or an analysis and a mode of it.",
            )
        self._round_size = settings.round_size
        (self._failure,) = context.make_replays()
        self._search = minimal_search.start_search(
            np.ascontiguousarray(self._failure.z, np.float32)
        )
        self._ends: tuple[int, ...] = ()

    def propose(self, n: int) -> Proposal:
        """Return the next candidates of this phase; empty after the end of the search."""
        first = len(self._ends)
        tried = minimal_search.list_candidates(self._search)[
            first : first + min(n, self._round_size)
        ]
        return Proposal(tuple(structs.replace(self._failure, z=z) for z in tried))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the ends of candidates; after a phase's last candidate, go on to the next phase.

        Raises:
            LearnerFailed: the failure does not reproduce at full strength.
        """
        if self._search.phase is minimal_search.SearchPhase.FULL:
            # A search that starts from a replay that is safe would take every removal for harmful.
            for result in results:
                _refuse_safe_replay(result)
        self._ends += tuple(map(_find_end, results))
        # Only then: which blocks are removed together depends on all candidates of a phase.
        if len(self._ends) == len(minimal_search.list_candidates(self._search)):
            self._search, self._ends = minimal_search.advance(self._search, self._ends), ()

    def state(self) -> bytes:
        """Return the state of the search."""
        facts = structs.asdict(self._search)
        # An array has a form of its own in an archive.
        z = facts.pop("z")
        return archive.write("minimal", MinimalFacts(**facts, ends=self._ends), {"z": z})

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("minimal", state, MinimalFacts)
        with archive.wrap_errors("minimal"):
            z = archive.take(arrays, "z", self._search.z.shape)
        known = structs.asdict(facts)
        self._ends = known.pop("ends")
        self._search = minimal_search.Search(z=z, **known)


def _find_end(result: EpisodeResult) -> int:
    """Return the step after which an episode failed, `SAFE`, or `NOT_RUN`."""
    if result.is_failure:
        return result.steps
    return minimal_search.NOT_RUN if result.outcome is Outcome.ERRORED else minimal_search.SAFE


def _refuse_safe_replay(result: EpisodeResult) -> None:
    """Refuse a failure that does not reproduce.

    Raises:
        LearnerFailed: the replay did not fail.
    """
    if result.outcome is not Outcome.SAFE:
        return
    nearest = f"{result.measures.distance_m:.2f} m" if result.measures else "something"
    raise LearnerFailed(
        "The failure does not reproduce at full strength: its replay did not fail, and stayed "
        f"{nearest} from other vehicles, so there is nothing to shrink.",
        "Shrink it in the scenario, and with the planner and the noise, of its own campaign.",
    )


def read_state(state: bytes) -> tuple[MinimalFacts, Floats]:
    """Return the facts of a state of this method, and its noise, shape (steps, channels).

    Raises:
        ProtocolError: the bytes are not a state of this method.
    """
    facts, arrays = archive.read("minimal", state, MinimalFacts)
    with archive.wrap_errors("minimal"):
        return facts, arrays["z"]
