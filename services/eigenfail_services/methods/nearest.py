"""Nearest failing points: the first failing noise on the way from a mode's centre to its medoid.

The centre of the failures' noise is not always a failure, but its medoid is. On the straight way
between them, (1 − t) · centre + t · medoid, the smallest failing t gives the failing noise nearest
to the centre. Failing is not assumed to be monotone in t. After the centre itself (t = 0), a grid
over the whole way is tried. The gap below its first failing point is then halved repeatedly. Points
between safe grid points are not tried.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import Injection, MethodTraits, Reference
from eigenfail.errors import InvalidValue
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal
from eigenfail.values.proof import ReplayKind
from eigenfail_services.methods import Id, archive

GRID = 8
"""Parts of the way from centre to medoid whose ends are tried: t = 1/8, 2/8, … 7/8."""

HALVINGS = 6
"""Halvings of the part below the first failing point: t is known to 1/512 of the way then."""

MOST_EPISODES = GRID + HALVINGS
"""Of one mode: the centre, the other points of the grid, and the halvings."""

Tried = Mapping[float, bool]
"""Whether an episode failed, by t."""


def list_next_points(tried: Tried) -> list[float]:
    """Return the values of t to try next on the way of one mode; empty after its search."""
    if 0.0 not in tried:
        return [0.0]
    if tried[0.0]:
        return []
    grid = [step / GRID for step in range(1, GRID)]
    # The whole grid at once: its points do not depend on each other, and workers run side by side.
    if missing := [t for t in grid if t not in tried]:
        return missing
    if len(tried) >= MOST_EPISODES:
        return []
    failing = find_nearest(tried)
    # t = 0 was tried and is safe here, so that there is one.
    below = max(t for t in tried if t < failing)
    return [(below + failing) / 2.0]


def find_nearest(tried: Tried) -> float:
    """Return the smallest failing t; 1, the medoid, if no point failed."""
    return min((t for t, failed in tried.items() if failed), default=1.0)


class Trial(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An episode at the point t of a mode's way; modes of the campaign are counted from 0.

    Attributes:
        failed: whether the episode failed; None while the result is open.
    """

    mode: int
    t: float
    failed: bool | None = None


class NearestSearch:
    """The search on the ways of several modes, with points and outcomes but without noise."""

    def __init__(self, modes: int, trials: Sequence[Trial] = ()) -> None:
        self.trials = list(trials)
        self._modes = modes

    def open(self, most: int) -> list[Trial]:
        """Return up to `most` points to try next; `close` expects their outcomes in this order."""
        points = (
            Trial(mode, t) for mode in range(self._modes) for t in list_next_points(self.read(mode))
        )
        # All modes at once: a mode has few points at a time, and one alone would leave workers
        # idle.
        opened = list(points)[:most]
        self.trials += opened
        return opened

    def close(self, outcomes: Sequence[bool]) -> None:
        """Record whether the oldest points without a result failed."""
        waiting = [place for place, trial in enumerate(self.trials) if trial.failed is None]
        for place, failed in zip(waiting, outcomes, strict=False):
            self.trials[place] = msgspec.structs.replace(self.trials[place], failed=failed)

    def read(self, mode: int) -> dict[float, bool]:
        """Return the results on the way of a mode."""
        return {
            each.t: each.failed
            for each in self.trials
            if each.mode == mode and each.failed is not None
        }


def place_trials(modes: int, outcomes: Sequence[bool]) -> list[Trial]:
    """Return the trials of a campaign from its outcomes, in index order.

    The search is deterministic: the tried points follow from the outcomes.
    """
    search, seen = NearestSearch(modes), 0
    while seen < len(outcomes) and (opened := search.open(len(outcomes) - seen)):
        search.close(outcomes[seen : seen + len(opened)])
        seen += len(opened)
    return search.trials


class NearestSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `nearest`."""

    analysis: Annotated[Id, Meta(description="whose modes are searched")]
    modes: Annotated[
        tuple[Id, ...],
        Meta(description="of that analysis, counted from 1; none given: all"),
    ] = ()
    what: Annotated[
        tuple[ReplayKind, ...],
        Meta(description="the two ends of a way: eigenfailure, then medoid"),
    ] = (ReplayKind.EIGENFAILURE, ReplayKind.MEDOID)


class NearestFailingPoint:
    """Searches the way from each mode's centre to its medoid for the first point that fails.

    The search is without random draws. It takes up to 14 episodes per mode, and one episode if the
    centre fails.

    Args:
        context: context with the centres of the modes, followed by their medoids, as trajectories.
        settings: settings with the analysis and its modes.

    Raises:
        InvalidValue: the trajectories are not pairs of centres and medoids.

    Attributes:
        lookahead: 0, as each point depends on earlier results.
    """

    Settings = NearestSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State: the trials so far."""

        trials: tuple[Trial, ...]

    traits = MethodTraits(
        learns=False,
        finds_new=False,
        is_evidence=True,
        injects=Injection.TRAJECTORIES,
        chart_mark=14,
        references={"analysis": Reference.NOISE},
    )
    lookahead = 0

    def __init__(self, context: LearnerContext, _settings: NearestSettings) -> None:
        count = len(context.trajectories)
        if not count or count % 2:
            raise InvalidValue(
                "settings",
                f"they name {count} trajectories, no pairs of a centre and a medoid.",
                'Name an analysis with failure modes; leave "what" as it is.',
            )
        half = count // 2
        sources = context.make_replays()
        self._centres, self._medoids = sources[:half], sources[half:]
        self._search = NearestSearch(half)

    def propose(self, n: int) -> Proposal:
        """Return the next points of all modes; empty after the search."""
        opened = self._search.open(n)
        ends = ((self._centres[each.mode], self._medoids[each.mode], each.t) for each in opened)
        return Proposal(tuple(mix_noise(*each) for each in ends))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Record which points failed; errored points count as safe."""
        self._search.close([result.is_failure for result in results])

    def state(self) -> bytes:
        """Return the trials so far."""
        return archive.write("nearest", self._Facts(tuple(self._search.trials)), {})

    def restore(self, state: bytes) -> None:
        """Restore a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, _ = archive.read("nearest", state, self._Facts)
        self._search = NearestSearch(len(self._centres), facts.trials)


def mix_noise(centre: TrajectorySource, medoid: TrajectorySource, t: float) -> TrajectorySource:
    """Return (1 − t) · centre + t · medoid, with the medoid's seed.

    A medoid's noise is 0 after the collision that ended its episode.
    """
    mixed = np.float32(1.0 - t) * centre.z + np.float32(t) * medoid.z
    return msgspec.structs.replace(medoid, z=mixed)
