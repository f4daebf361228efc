"""Subset simulation: a small failure probability as a product of larger conditional ones."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import ceil, inf
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits, ModeProbability
from eigenfail.errors import InvalidValue
from eigenfail.values import (
    EpisodeResult,
    Estimate,
    LearnerContext,
    Proposal,
    TrajectorySource,
)
from eigenfail_services.methods import archive, robustness_m
from eigenfail_services.statistics.pooled_estimate import (
    estimate_unfinished,
    pool_simulations,
    refuse_estimate,
)
from eigenfail_services.statistics.subset_simulation import (
    Array,
    Chains,
    SubsetEnd,
    SubsetEstimate,
    SubsetSettings,
    SubsetSimulation,
    estimate_from_failures,
    estimate_lineage_variation,
    estimate_without_failures,
    make_level,
)

PLANNED_LEVELS = 7


MIN_SAMPLES = 20


MAX_SAMPLES = 100_000


class SubsetMethodSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `subset`.

    Without `samples`, a level has as many as the budget allows over seven levels in each run, which
    suffices for a probability of 1e-6 at a share of 0.1.
    """

    samples: Annotated[
        Annotated[int, Meta(ge=MIN_SAMPLES, le=MAX_SAMPLES)] | None,
        Meta(description="samples on each level of a run; none given: what the budget allows"),
    ] = None
    level_share: Annotated[
        float, Meta(ge=0.05, le=0.5, description="share of them that is to reach the next level")
    ] = 0.1
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to be accepted")
    ] = 0.4
    most_levels: Annotated[int, Meta(ge=1, le=100, description="levels at most")] = 20
    runs: Annotated[
        int, Meta(ge=1, le=10, description="independent runs, to be compared with each other")
    ] = 2
    round_size: Annotated[
        int, Meta(ge=1, le=100_000, description="episodes in a round at most")
    ] = 10_000

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget allows too few samples."""
        self.make_settings(episodes)

    def make_settings(self, episodes: int) -> SubsetSettings:
        """Return the settings of one run for the budget of all runs.

        Raises:
            InvalidValue: the budget allows too few samples.
        """
        samples = self.samples or self._find_samples(episodes)
        if samples < MIN_SAMPLES:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {MIN_SAMPLES} samples on each of {PLANNED_LEVELS} "
                f"levels in {self.runs} runs, which take {self._count_episodes(MIN_SAMPLES)}.",
                "Give more episodes: with tens of thousands the estimate is good.",
            )
        return SubsetSettings(
            samples=samples,
            share=self.level_share,
            acceptance=self.acceptance,
            most_levels=self.most_levels,
        )

    def _find_samples(self, episodes: int) -> int:
        """Return the largest number of samples with which the planned levels fit the budget."""
        counts = range(MAX_SAMPLES + 1)
        return bisect_right(counts, episodes, lo=MIN_SAMPLES, key=self._count_episodes) - 1

    def _count_episodes(self, samples: int) -> int:
        """Return the episodes of all runs; on later levels, the seeds are not run again."""
        seeds = round(self.level_share * samples)
        moves = (ceil(samples / seeds) - 1) * seeds
        return self.runs * (samples + (PLANNED_LEVELS - 1) * moves)


class SimulationRun:
    """One subset simulation, which is run from wave to wave.

    Attributes:
        simulation: its present state.
        requested: noise z to be run, shape (n, steps, 2); empty after the end.
        result: its estimate, after the end.
    """

    def __init__(self, steps: int, settings: SubsetSettings, seed: Sequence[int]) -> None:
        self.simulation = SubsetSimulation(steps, settings, seed)
        self._running = self.simulation.run()
        self.requested: Array = next(self._running)
        self.result: SubsetEstimate | None = None

    def add_robustness(self, robustness: Array) -> None:
        """Continue with the robustness of the requested noise, NaN for failed runs, shape (n,)."""
        if self.result is not None:
            return
        try:
            self.requested = self._running.send(robustness)
        except StopIteration as end:
            self.result, self.requested = end.value, self.requested[:0]


class WaveQueue:
    """Waves of the noise of several simulations, which may be run in pieces.

    Attributes:
        runs: one for each simulation.
        robustness: robustness of all noise so far, in order, NaN for failed runs. [m]
        wave: noise that all of them request, shape (n, steps, 2); empty after the end of all.
        proposed: number of trajectories of the wave that were taken.
    """

    def __init__(self, runs: Sequence[SimulationRun]) -> None:
        self.runs = tuple(runs)
        self.robustness: list[float] = []
        self._open()

    def take(self, n: int) -> Array:
        """Return at most n of the remaining trajectories, shape (up to n, steps, 2)."""
        chosen = self.wave[self.proposed : self.proposed + n]
        self.proposed += len(chosen)
        return chosen

    def add_robustness(self, robustness: Sequence[float]) -> None:
        """Add the robustness of the next trajectories, which may fill several waves.

        Raises:
            ValueError: all simulations have ended.
        """
        for value in robustness:
            if not len(self.wave):
                raise ValueError("there are more episodes than the simulations requested")
            self.robustness.append(value)
            self._received.append(value)
            if len(self._received) == len(self.wave):
                self._finish_wave(np.array(self._received))

    def _open(self) -> None:
        self.wave: Array = np.concatenate([one.requested for one in self.runs])
        self.proposed = 0
        self._received: list[float] = []

    def _finish_wave(self, robustness: Array) -> None:
        ends = np.cumsum([len(one.requested) for one in self.runs])[:-1]
        for one, values in zip(self.runs, np.split(robustness, ends), strict=True):
            one.add_robustness(values)
        self._open()


MAX_ROUND_NUMBERS = 5_000_000
"""Most numbers of noise in a round, which is sent as one message."""


class SubsetMethod:
    """Descends the levels of robustness to failures, in several independent runs.

    All runs request a wave of episodes at a time: draws from the prior on the first level, then a
    move of every chain. It ends when all runs have ended. Its first run is `subset_simulation` with
    the learner's seed. Its state is the robustness of every episode and nothing else: the noise
    follows from that and the seed.

    Attributes:
        lookahead: 0, as each wave depends on the one before.

    Raises:
        InvalidValue: the budget allows too few samples.
    """

    Settings = SubsetMethodSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides robustness: number of episodes of the wave that were proposed."""

        proposed: Annotated[int, msgspec.Meta(ge=0)]

    traits = MethodTraits(
        learns=False, mode_probability=ModeProbability.LEVELS, chart_mark=4, references={}
    )
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: SubsetMethodSettings) -> None:
        self._context = context
        self._runs = settings.runs
        self._round_size = min(settings.round_size, 1 + MAX_ROUND_NUMBERS // (2 * context.horizon))
        self._run_settings = settings.make_settings(context.episodes)
        self._waves = self._start_runs()

    def propose(self, n: int) -> Proposal:
        """Return the rest of the wave, at most a round; nothing after the end of all runs."""
        chosen = self._waves.take(min(n, self._round_size)).astype(np.float32)
        return Proposal(tuple(map(TrajectorySource, chosen)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the robustness of episodes; a complete wave leads to the next one."""
        self._waves.add_robustness([robustness_m(result) for result in results])

    def estimate(self) -> Estimate | None:
        """Return the failure probability; before the end of all runs, a preliminary statement."""
        runs = self._waves.runs
        found = [one.result for one in runs if one.result is not None]
        if len(found) == self._runs:
            return pool_simulations(found, self._run_settings.samples)
        simulations = [one.simulation for one in runs]
        ran = sum(one.evaluations for one in simulations)
        spent = len(self._waves.robustness) >= self._context.episodes
        return estimate_unfinished([one.levels for one in simulations], ran, spent)

    def state(self) -> bytes:
        """Return the robustness of all episodes so far."""
        values: archive.Array = np.array(self._waves.robustness, np.float64)
        facts = self._Facts(self._waves.proposed)
        return archive.write("subset", facts, {"robustness_m": values})

    def restore(self, state: bytes) -> None:
        """Restore a state by running the simulations again with the known robustness.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("subset", state, self._Facts)
        waves = self._start_runs()
        with archive.wrap_errors("subset"):
            waves.add_robustness(arrays["robustness_m"].astype(np.float64).tolist())
        waves.proposed = facts.proposed
        self._waves = waves

    def _start_runs(self) -> WaveQueue:
        steps, seed = self._context.horizon, self._context.seed
        return WaveQueue(
            [SimulationRun(steps, self._run_settings, (seed, run)) for run in range(self._runs)]
        )


MIN_LINEAGES = 5.0
"""Least number of effective independent first draws behind the failures of a mode: with fewer, both
the mode and its share are due to chance."""


NONE = -1


def estimate_modes(
    runs: Sequence[SimulationRun],
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """Return P of each mode: P of the last level but one, times the mode's share in the last one.

    Args:
        runs: new runs of the simulations that requested the episodes; they are run again.
        robustness: robustness of each episode in index order, 0 of a failure. [m]
        mode_of: mode of each failure, by the index of its episode.
        modes: number of modes.

    Returns:
        None unless all simulations reached failures.
    """
    index_of = replay_waves(runs, robustness)
    chains = [each.simulation.chains for each in runs]
    if any(each is None for each in chains):
        return None
    found = [label_samples(each, index_of, mode_of) for each in chains if each is not None]
    return tuple(_estimate_mode(runs, found, mode) for mode in range(modes))


def replay_waves(runs: Sequence[SimulationRun], robustness: Sequence[float]) -> dict[bytes, int]:
    """Run the simulations again; return the index of each failure by its noise."""
    waves, index_of, count = WaveQueue(runs), dict[bytes, int](), 0
    while len(waves.wave) and count + len(waves.wave) <= len(robustness):
        values = robustness[count : count + len(waves.wave)]
        failed = np.flatnonzero(np.array(values) <= 0.0).tolist()
        index_of |= {waves.wave[row].tobytes(): count + row for row in failed}
        count += len(values)
        waves.add_robustness(values)
    return index_of


def label_samples(
    chains: Chains, index_of: Mapping[bytes, int], mode_of: Mapping[int, int]
) -> NDArray[np.int64]:
    """Return the mode of each sample of a level, shape (length, chains); -1 for no failure."""
    found = np.full(chains.values.shape, NONE)
    for place in np.argwhere(chains.values <= 0.0).tolist():
        index = index_of[chains.z[tuple(place)].tobytes()]
        found[tuple(place)] = mode_of.get(index, NONE)
    return found


def _estimate_mode(
    runs: Sequence[SimulationRun], found: Sequence[NDArray[np.int64]], mode: int
) -> Estimate:
    """Return the estimate of one mode, or the reason why there is none."""
    each = [_restrict_to_mode(one, own == mode) for one, own in zip(runs, found, strict=True)]
    worth = sum(
        count_lineages(one.simulation.chains, own == mode)
        for one, own in zip(runs, found, strict=True)
    )
    if worth < MIN_LINEAGES:
        episodes = sum(one.evaluations for one in each)
        problem = (
            f"Its failures on the last level are worth {worth:.1f} independent first draws, and it "
            f"takes {MIN_LINEAGES:.0f}. Give the campaign more episodes."
        )
        return refuse_estimate(episodes, problem)
    return pool_simulations(each, found[0].size)


def _restrict_to_mode(run: SimulationRun, inside: NDArray[np.bool_]) -> SubsetEstimate:
    """Return a simulation's estimate if only some samples of its last level were failures.

    Args:
        run: run of the simulation.
        inside: mask of these samples, shape (length, chains).
    """
    simulation = run.simulation
    chains = simulation.chains
    if chains is None or not inside.any():
        return estimate_without_failures(
            simulation.levels, SubsetEnd.STALLED, simulation.evaluations
        )
    own = chains._replace(values=np.where(inside, 0.0, inf))
    levels = (*simulation.levels[:-1], make_level(own, 0.0))
    return estimate_from_failures(levels, own, simulation.evaluations)


def count_lineages(chains: Chains | None, inside: NDArray[np.bool_]) -> float:
    """Return the effective number of first draws behind samples: (sum d)² ÷ sum d² (Kish 1965).

    Args:
        chains: number of chains of a level; None without a level.
        inside: mask of its samples, shape (length, chains).
    """
    if chains is None or not inside.any():
        return 0.0
    descendants = np.bincount(chains.ancestors, inside.sum(axis=0))
    return estimate_lineage_variation(descendants) ** -2
