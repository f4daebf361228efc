"""Replay: injects given noise trajectories, to prove that their effect is reproducible."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import Injection, MethodTraits, Reference
from eigenfail.errors import InvalidValue
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.learning import LearnerContext, Proposal, count_rounds_ahead
from eigenfail.values.proof import ReplayKind
from eigenfail_services.methods import Amount, Id, RoundSize, archive


class ReplaySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `replay`: an analysis (replays its modes) or a campaign (replays its noise)."""

    analysis: Annotated[Id | None, Meta(description="replay what this analysis found")] = None
    what: Annotated[
        tuple[ReplayKind, ...],
        Meta(min_length=1, description="of that analysis, mode by mode of each"),
    ] = (ReplayKind.EIGENFAILURE,)
    modes: Annotated[
        tuple[Id, ...],
        Meta(description="of that analysis, counted from 1; none given: all"),
    ] = ()
    campaign: Annotated[
        Id | None, Meta(description="replay the noise of this campaign's episodes")
    ] = None
    episodes: Annotated[
        tuple[Annotated[int, Meta(ge=0)], ...],
        Meta(description="of that campaign; none given: all of its failures"),
    ] = ()
    repeats: Annotated[Amount, Meta(description="passes through the trajectories")] = 1
    scale: Annotated[
        float, Meta(ge=0.0, le=10.0, description="the noise is multiplied by this")
    ] = 1.0
    round_size: RoundSize = 100


class Replay:
    """Injects the trajectories of its context in order, one per episode, then ends.

    Args:
        context: context with the trajectories.
        settings: settings with the source of the trajectories and the number of passes.

    Raises:
        InvalidValue: the trajectories are missing.
    """

    Settings = ReplaySettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State: the number of proposed episodes."""

        proposed: Annotated[int, Meta(ge=0)]

    traits = MethodTraits(
        tolerates_delay=True,
        learns=False,
        observes=False,
        finds_new=False,
        is_evidence=True,
        pairable=True,
        injects=Injection.TRAJECTORIES,
        chart_mark=8,
        references={"analysis": Reference.NOISE, "campaign": Reference.NOISE},
    )
    lookahead = 3

    def __init__(self, context: LearnerContext, settings: ReplaySettings) -> None:
        if not len(context.trajectories):
            raise InvalidValue(
                "settings",
                "there is no noise trajectory to replay.",
                "Name an analysis with failure modes, or a campaign with failures.",
            )
        # float32 times float32: the noise keeps the type in which it is stored, and with scale 1
        # every bit.
        scale, replays = np.float32(settings.scale), context.make_replays()
        self._sources = [msgspec.structs.replace(each, z=scale * each.z) for each in replays]
        self._round_size = settings.round_size
        self.lookahead = count_rounds_ahead(context.parallel, self._round_size, self.lookahead)
        # Passes end the campaign, also if its budget allows for more.
        self._total = len(self._sources) * settings.repeats
        self._proposed = 0

    def propose(self, n: int) -> Proposal:
        """Return the next trajectories; empty after the last pass."""
        first = self._proposed
        self._proposed = min(first + min(n, self._round_size), self._total)
        chosen = (self._sources[i % len(self._sources)] for i in range(first, self._proposed))
        return Proposal(tuple(chosen))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Do nothing: replay does not learn."""

    def state(self) -> bytes:
        """Return the number of proposed episodes."""
        return archive.write("replay", self._Facts(self._proposed), {})

    def restore(self, state: bytes) -> None:
        """Restore a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, _ = archive.read("replay", state, self._Facts)
        self._proposed = facts.proposed
