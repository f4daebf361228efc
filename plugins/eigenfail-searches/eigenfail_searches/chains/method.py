"""Markov chains of failures: samples of p(z | failure), from failures of an earlier campaign."""

from collections.abc import Sequence
from math import ceil, nan
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.contracts import Injection, MethodTraits, Reference
from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.settings import read_settings
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import Campaign
from eigenfail.values.episode import EpisodeResult, Outcome, TrajectorySource
from eigenfail.values.estimates import ChainMixing
from eigenfail.values.learning import OPEN_GROUPS, LearnerContext, Proposal, RoundSizes
from eigenfail.worlds import list_channels
from eigenfail_searches.chains.diagnostics import STARTS, judge_projections, measure_projections
from eigenfail_searches.chains.projections import find_directions, rename_channels
from eigenfail_searches.chains.sampler import ChainSampler, MoveKind, MoveMix
from eigenfail_services.methods import archive

FEWEST_ROUNDS = 10

MOST_WATCHED = 80_000
"""Draws of all chains together, times channels, that are kept for the diagnostics: the projections
of a draw grow in number with the channels. Of more draws, those of every k-th move are kept."""

Weight = Annotated[float, Meta(ge=0.0, le=1000.0)]


class ChainSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `chains`."""

    campaign: Annotated[
        int, Meta(ge=1, description="the campaign from whose failures the chains start")
    ]
    chains: Annotated[
        int, Meta(ge=2, le=1000, description="chains, each of which moves once in a round")
    ] = 5
    burn_in: Annotated[
        float, Meta(ge=0.0, le=0.9, description="share of the budget before samples count")
    ] = 0.4
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to fail")
    ] = 0.3
    redraw: Annotated[Weight, Meta(description="weight of moves that redraw random values")] = 0.25
    window: Annotated[
        Weight, Meta(description="weight of moves that redraw 3 to 15 successive steps")
    ] = 0.25
    pcn: Annotated[Weight, Meta(description="weight of moves that change all values a little")] = (
        0.25
    )
    shift: Annotated[
        Weight, Meta(description="weight of moves that shift a segment by 1 to 10 steps")
    ] = 1.5
    smooth: Annotated[
        Weight, Meta(description="weight of moves that redraw sums over 5 to 30 steps")
    ] = 1.5
    detail: Annotated[
        Weight,
        Meta(description="weight of moves that redraw 10 to 50 steps but for mean and trend"),
    ] = 2.0

    def __post_init__(self) -> None:
        """Check that there is a move.

        Raises:
            InvalidValue: all weights are 0.
        """
        if not any(self.weights.values()):
            problem = "the weights of all kinds of moves are 0: no chain moves."
            raise InvalidValue("settings.redraw", problem, "Make one of them positive.")

    @property
    def weights(self) -> dict[MoveKind, float]:
        """Weight of each kind of move."""
        return {
            MoveKind.REDRAW: self.redraw,
            MoveKind.WINDOW: self.window,
            MoveKind.PCN: self.pcn,
            MoveKind.SHIFT: self.shift,
            MoveKind.SMOOTH: self.smooth,
            MoveKind.DETAIL: self.detail,
        }

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget allows too few moves."""
        fewest = FEWEST_ROUNDS * self.chains
        if episodes < fewest:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {FEWEST_ROUNDS} rounds of {self.chains} chains, which "
                f"take {fewest}.",
                "Give more episodes: chains need hundreds of rounds to mix.",
            )

    def count_moves(self, episodes: int) -> tuple[int, int]:
        """Return the moves of each chain in a budget: those of burn-in, and all."""
        moves = max(ceil(episodes / self.chains) - 1, 0)
        return ceil(self.burn_in * moves), moves

    def first_sample(self, episodes: int) -> int:
        """Return the index of the first episode whose failure is a sample of p(z | failure)."""
        return self.chains * (1 + self.count_moves(episodes)[0])


class ChainFacts(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """State of chains besides their noise.

    Attributes:
        started: number of starts that failed in the first round; 0 before it.
        moved: number of moves of each chain that were proposed and observed.
        ahead: number of groups of chains that have moved once more.
        opened: number of groups whose move is proposed and not yet observed.
        tried: number of moves after burn-in that were completed, of all chains.
        accepted: number of them that failed.
        redraw: size of the moves that redraw values.
        pcn: size of the moves that change all values.
        burn_in: number of moves of each chain before samples count.
        projections: names of the columns of the trace.
    """

    started: Annotated[int, Meta(ge=0)]
    moved: Annotated[int, Meta(ge=0)]
    tried: Annotated[int, Meta(ge=0)]
    accepted: Annotated[int, Meta(ge=0)]
    redraw: float
    pcn: float
    burn_in: int
    projections: tuple[str, ...]
    ahead: Annotated[int, Meta(ge=0)] = 0
    opened: Annotated[int, Meta(ge=0)] = 0


class FailureChains:
    """Moves chains from failure to failure, a move of each chain in a round.

    With `parallel` groups of chains take turns, a round each, and do not wait for each other.

    The first round runs the starts. A chain whose start does not fail begins where another one's
    did. An errored episode is a move that is not accepted.

    Args:
        context: its trajectories are the known failures.
        settings: name their campaign, and say how to move.

    Raises:
        InvalidValue: there is no failure.

    Attributes:
        lookahead: 0, as each move depends on the one before; once chains have started in groups,
            what `parallel` takes, and at most a round of each group.
    """

    Settings = ChainSettings

    traits = MethodTraits(
        tolerates_delay=True,
        learns=False,
        finds_new=False,
        injects=Injection.FAILURES,
        chart_mark=12,
        references={"campaign": Reference.NOISE},
    )
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: ChainSettings) -> None:
        if not len(context.trajectories):
            raise InvalidValue(
                "settings.campaign",
                f"campaign {settings.campaign} has no failure to start from.",
                "Name a campaign with failures, such as one of ast.",
            )
        self._directions = find_directions(context.trajectories)
        self._burn_in, moves = settings.count_moves(context.episodes)
        watched = (moves - self._burn_in) * settings.chains * context.channels
        self._stride = max(ceil(watched / MOST_WATCHED), 1)
        mix = MoveMix(
            weights=settings.weights, acceptance=settings.acceptance, adapted=self._burn_in
        )
        z = choose_starts(context.trajectories, settings.chains, context.seed)
        self._sampler = ChainSampler(z, count_steps(z), mix, context.seed, context.parallel)
        self._ahead = min(OPEN_GROUPS, len(self._sampler.groups)) - 1
        self._severity = np.full(settings.chains, nan)
        self._started = self._tried = self._accepted = 0
        self._trace: list[NDArray[np.float32]] = []

    @staticmethod
    def round_sizes(settings: ChainSettings, _episodes: int) -> RoundSizes:
        """Return the size of the rounds, in which every chain moves once."""
        return RoundSizes(settings.chains, settings.chains, "chains", width=settings.chains)

    @staticmethod
    def judge_mixing(campaign: Campaign, state: bytes) -> ChainMixing | None:
        """Return how far the chains of a campaign have mixed; None before they start.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, trace = read_state(state)
        if not facts.started:
            return None
        # The learner numbers channels; people know them by the names of the campaign.
        names = rename_channels(facts.projections, list_channels(campaign.spec))
        projections = measure_projections(names, trace)
        mixed, verdict = judge_projections(projections)
        settings = read_settings(ChainSettings, dict(campaign.spec.settings), "settings")
        return ChainMixing(
            campaign=campaign.id,
            chains=trace.shape[1],
            started=facts.started,
            moves=facts.tried,
            accepted=facts.accepted,
            first_sample=settings.first_sample(campaign.spec.episodes),
            draws=len(trace),
            projections=projections,
            mixed=mixed,
            verdict=verdict,
            remark=STARTS,
        )

    def propose(self, n: int) -> Proposal:
        """Return the starts, then a move of each chain of a group."""
        z = self._sampler.propose(n) if self._started else self._sampler.z[:n].copy()
        return Proposal(tuple(map(TrajectorySource, z)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Move the chains whose noise failed.

        Raises:
            LearnerFailed: none of the starts failed.
        """
        ends = np.array([result.steps for result in results])
        failed = np.array([result.is_failure for result in results])
        ran = np.array([result.outcome is not Outcome.ERRORED for result in results])
        z, severities = self._stack(results), _read_severities(results)
        if not self._started:
            self._severity[: len(results)] = severities
            self._start(z, ends, failed, ran)
            return
        sampler = self._sampler
        rows, move = sampler.find_tried(len(results)), sampler.moved
        self._severity[rows[failed]] = severities[failed]
        sampler.accept(z, ends, failed, ran)
        if move >= self._burn_in:
            self._tried += int(ran.sum())
            self._accepted += int(failed.sum())
            if sampler.moved > move and len(rows) == len(sampler.groups[-1]):
                self._record()

    def _stack(self, results: Sequence[EpisodeResult]) -> Floats:
        z = np.zeros((len(results), *self._sampler.z.shape[1:]), np.float32)
        for row, result in zip(z, results, strict=True):
            row[: len(result.noise.z)] = result.noise.z
        return z

    def _start(
        self,
        z: Floats,
        ends: NDArray[np.int64],
        failed: NDArray[np.bool_],
        ran: NDArray[np.bool_],
    ) -> None:
        """Begin each chain at a start that failed, its own if that did."""
        if not failed.any():
            if ran.any():
                _refuse_safe_starts(int(ran.sum()))
            return
        places = np.flatnonzero(failed)
        taken = np.resize(places, len(self._severity))
        taken[places] = places
        self._sampler.z, self._sampler.ends = z[taken], ends[taken]
        self._severity = self._severity[taken]
        self._started = len(places)
        self.lookahead = self._ahead

    def _record(self) -> None:
        """Keep the projections of every chain after a move of all, if it is the turn of a draw."""
        sampler = self._sampler
        if not (sampler.moved - self._burn_in) % self._stride:
            self._trace.append(self._directions.measure(sampler.z, sampler.ends, self._severity))

    def state(self) -> bytes:
        """Return the state of the chains, and the projections of their samples."""
        sampler = self._sampler
        names = self._directions.list_projections()
        facts = ChainFacts(
            started=self._started,
            moved=sampler.moved,
            tried=self._tried,
            accepted=self._accepted,
            redraw=sampler.sizes[MoveKind.REDRAW],
            pcn=sampler.sizes[MoveKind.PCN],
            burn_in=self._burn_in,
            projections=names,
            ahead=sampler.tried % len(sampler.groups),
            opened=sampler.opened,
        )
        trace = np.array(self._trace, np.float32).reshape(-1, len(self._severity), len(names))
        arrays: dict[str, archive.Array] = {
            "z": sampler.z,
            "ends": sampler.ends,
            "severity": self._severity,
            "trace": trace,
        }
        return archive.write("chains", facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, from which the chains go on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("chains", state, ChainFacts)
        sampler, names = self._sampler, self._directions.list_projections()
        with archive.wrap_errors("chains"):
            z = archive.take(arrays, "z", sampler.z.shape)
            ends = archive.take(arrays, "ends", sampler.ends.shape)
            severity = archive.take(arrays, "severity", self._severity.shape)
            trace = arrays["trace"].reshape(-1, len(severity), len(names))
            if facts.ahead >= len(sampler.groups) or facts.opened > len(sampler.groups):
                raise ValueError(f"they are of more than {len(sampler.groups)} groups of chains")
        sampler.z, sampler.ends = z, ends
        sampler.tried = facts.moved * len(sampler.groups) + facts.ahead
        sampler.opened = facts.opened
        sampler.sizes = {MoveKind.REDRAW: facts.redraw, MoveKind.PCN: facts.pcn}
        self._severity, self._trace = severity, list(trace)
        self._started, self._tried, self._accepted = facts.started, facts.tried, facts.accepted
        self.lookahead = self._ahead if self._started else 0


def choose_starts(failures: Floats, chains: int, seed: int) -> Floats:
    """Return a failure for each chain: a systematic sample of the failures (Kitagawa 1996).

    The failures are sorted by their noise from the first step on. Those of `splitting` that descend
    from one episode share their first steps, and are then neighbours: each family has its share of
    the chains, to within one chain. If there are fewer failures than chains, each starts
    several.

    Args:
        failures: z of each, shape (n, steps, channels).
        chains: number of chains.
        seed: seed of the draw.
    """
    rng = np.random.default_rng([seed, 0, 0])
    n = len(failures)
    if n <= chains:
        places = np.resize(rng.permutation(n), chains)
    else:
        values = failures.reshape(n, -1)
        # lexsort takes its last key first.
        order = np.lexsort(values.T[::-1])
        places = order[((np.arange(chains) + rng.random()) * n / chains).astype(int)]
    starts: Floats = failures[places]
    return starts


def count_steps(z: Floats) -> NDArray[np.int64]:
    """Return the number of steps up to the last one with noise, shape (n,).

    Recorded noise ends with its episode, and is padded with zeros.

    Args:
        z: shape (n, steps, channels).
    """
    steps: NDArray[np.int64] = np.where(z.any(axis=2), np.arange(1, z.shape[1] + 1), 0).max(axis=1)
    return steps


def _read_severities(results: Sequence[EpisodeResult]) -> NDArray[np.float64]:
    known = [result.measures.severity if result.measures else None for result in results]
    return np.array([nan if each is None else each for each in known])


def _refuse_safe_starts(starts: int) -> None:
    raise LearnerFailed(
        f"None of the {starts} failures from which the chains were to start fails here.",
        "Start from failures of this scenario and planner, with the noise of their own campaign.",
    )


def read_state(state: bytes) -> tuple[ChainFacts, NDArray[np.float32]]:
    """Return the facts in a state of this method, and its trace.

    The trace has the shape (draws, chains, projections).

    Raises:
        ProtocolError: the bytes are not a state of this method.
    """
    facts, arrays = archive.read("chains", state, ChainFacts)
    with archive.wrap_errors("chains"):
        return facts, arrays["trace"]
