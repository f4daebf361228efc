"""Subset simulation: a small failure probability as a product of larger conditional ones."""

from collections.abc import Mapping, Sequence
from math import inf
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
    explain_missing_runs,
    pool_simulations,
    refuse_estimate,
)
from eigenfail_services.statistics.subset_simulation import (
    FEWEST_SAMPLES,
    PLANNED_LEVELS,
    Array,
    Chains,
    LevelRun,
    SubsetEnd,
    SubsetEstimate,
    SubsetSettings,
    SubsetSimulation,
    estimate_from_failures,
    estimate_without_failures,
    make_level,
)

MAX_SAMPLES = 100_000


class SubsetMethodSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `subset`."""

    samples: Annotated[
        Annotated[int, Meta(ge=FEWEST_SAMPLES, le=MAX_SAMPLES)] | None,
        Meta(
            description="samples on each level of a run at most; none given: what the budget allows"
        ),
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
        """Raise InvalidValue if the budget allows too few samples, unless they were chosen."""
        fewest = self.make_settings().count_fewest()
        if self.samples is None and episodes < fewest:
            raise InvalidValue(
                "episodes",
                f"{episodes} are fewer than {FEWEST_SAMPLES} samples on each of {PLANNED_LEVELS} "
                f"levels in a pilot run and {self.runs} further runs, which take {fewest}.",
                "Give more episodes: with tens of thousands the estimate is good.",
            )

    def make_settings(self) -> SubsetSettings:
        """Return the settings of the simulation."""
        return SubsetSettings(
            samples=self.samples,
            share=self.level_share,
            acceptance=self.acceptance,
            most_levels=self.most_levels,
            runs=self.runs,
        )


class WaveQueue:
    """Waves of the noise of a simulation, which may be run in pieces.

    Attributes:
        simulation: simulation that requests the noise.
        robustness: robustness of all noise so far, in order, NaN for failed runs. [m]
        wave: noise that is requested, shape (n, steps, 2); empty after the end.
        proposed: number of trajectories of the wave that were taken.
    """

    def __init__(self, simulation: SubsetSimulation) -> None:
        self.simulation = simulation
        self._running = simulation.run()
        self.robustness: list[float] = []
        self.wave: Array = next(self._running)
        self.proposed = 0
        self._received: list[float] = []

    @property
    def is_done(self) -> bool:
        """Whether the simulation has ended."""
        return not len(self.wave)

    def take(self, n: int) -> Array:
        """Return at most n of the remaining trajectories, shape (up to n, steps, 2)."""
        chosen = self.wave[self.proposed : self.proposed + n]
        self.proposed += len(chosen)
        return chosen

    def add_robustness(self, robustness: Sequence[float]) -> None:
        """Add the robustness of the next trajectories, which may fill several waves.

        Raises:
            ValueError: the simulation has ended.
        """
        for value in robustness:
            if self.is_done:
                raise ValueError("there are more episodes than the simulation requested")
            self.robustness.append(value)
            self._received.append(value)
            if len(self._received) == len(self.wave):
                self._finish_wave(np.array(self._received))

    def _finish_wave(self, robustness: Array) -> None:
        try:
            self.wave = self._running.send(robustness)
        except StopIteration:
            self.wave = self.wave[:0]
        self.proposed, self._received = 0, []


MAX_ROUND_NUMBERS = 5_000_000
"""Most numbers of noise in a round, which is sent as one message."""


class SubsetMethod:
    """Descends the levels of robustness to failures: a pilot run, then several independent runs.

    A wave of episodes is requested at a time: draws from the prior on the first level, then a move
    of every chain of all runs. Its state is the robustness of every episode and nothing else: the
    noise follows from that and the seed.

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
        settings.check_budget(context.episodes)
        self._context = context
        self._round_size = min(settings.round_size, 1 + MAX_ROUND_NUMBERS // (2 * context.horizon))
        self._settings = settings.make_settings()
        self._waves = self._start()

    def propose(self, n: int) -> Proposal:
        """Return the rest of the wave, at most a round; nothing after the end of all runs."""
        chosen = self._waves.take(min(n, self._round_size)).astype(np.float32)
        return Proposal(tuple(map(TrajectorySource, chosen)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Add the robustness of episodes; a complete wave leads to the next one."""
        self._waves.add_robustness([robustness_m(result) for result in results])

    def estimate(self) -> Estimate | None:
        """Return the failure probability; before the end of all runs, a preliminary statement."""
        simulation = self._waves.simulation
        if not self._waves.is_done:
            spent = len(self._waves.robustness) >= self._context.episodes
            return estimate_unfinished(simulation, spent)
        found = [one.result for one in simulation.runs if one.result is not None]
        if not found:
            return explain_missing_runs(simulation)
        return pool_simulations(found, simulation.runs[0].draws, simulation.evaluations)

    def state(self) -> bytes:
        """Return the robustness of all episodes so far."""
        values: archive.Array = np.array(self._waves.robustness, np.float64)
        facts = self._Facts(self._waves.proposed)
        return archive.write("subset", facts, {"robustness_m": values})

    def restore(self, state: bytes) -> None:
        """Restore a state by running the simulation again with the known robustness.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("subset", state, self._Facts)
        waves = self._start()
        with archive.wrap_errors("subset"):
            waves.add_robustness(arrays["robustness_m"].astype(np.float64).tolist())
        waves.proposed = facts.proposed
        self._waves = waves

    def _start(self) -> WaveQueue:
        return WaveQueue(start_simulation(self._context, self._settings))


def start_simulation(context: LearnerContext, settings: SubsetSettings) -> SubsetSimulation:
    """Return the simulation of a campaign, before its first wave."""
    return SubsetSimulation(context.horizon, context.episodes, settings, (context.seed,))


MIN_LINEAGES = 5.0
"""Least number of effective independent first draws behind the failures of a mode: with fewer, both
the mode and its share are due to chance."""


NONE = -1


def estimate_modes(
    simulation: SubsetSimulation,
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """Return P of each mode: P of the last level but one, times the mode's share in the last one.

    Args:
        simulation: simulation of the campaign before its first wave; it is run again.
        robustness: robustness of each episode in index order, 0 of a failure. [m]
        mode_of: mode of each failure, by the index of its episode.
        modes: number of modes.

    Returns:
        None unless all runs reached failures.
    """
    index_of = replay_waves(simulation, robustness)
    chains = [each.chains for each in simulation.runs]
    if not chains or any(each is None for each in chains):
        return None
    found = [label_samples(each, index_of, mode_of) for each in chains if each is not None]
    return tuple(_estimate_mode(simulation, found, mode) for mode in range(modes))


def replay_waves(simulation: SubsetSimulation, robustness: Sequence[float]) -> dict[bytes, int]:
    """Run a simulation again; return the index of each failure by its noise."""
    waves, index_of, count = WaveQueue(simulation), dict[bytes, int](), 0
    while not waves.is_done and count + len(waves.wave) <= len(robustness):
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
    simulation: SubsetSimulation, found: Sequence[NDArray[np.int64]], mode: int
) -> Estimate:
    """Return the estimate of one mode, or the reason why there is none."""
    each = [
        _restrict_to_mode(run, own == mode) for run, own in zip(simulation.runs, found, strict=True)
    ]
    worth = sum(one.effective for one in each)
    if worth < MIN_LINEAGES:
        problem = (
            f"Its failures on the last level are worth {worth:.1f} independent first draws, and it "
            f"takes {MIN_LINEAGES:.0f}. Give the campaign more episodes."
        )
        return refuse_estimate(simulation.evaluations, problem)
    return pool_simulations(each, simulation.runs[0].draws, simulation.evaluations)


def _restrict_to_mode(run: LevelRun, inside: NDArray[np.bool_]) -> SubsetEstimate:
    """Return a run's estimate if only some samples of its last level were failures.

    Args:
        run: run over the levels.
        inside: mask of these samples, shape (length, chains).
    """
    evaluations = run.result.evaluations if run.result else 0
    if run.chains is None or not inside.any():
        return estimate_without_failures(run.levels, SubsetEnd.MISSED, evaluations)
    own = run.chains._replace(values=np.where(inside, 0.0, inf))
    levels = (*run.levels[:-1], make_level(own, 0.0))
    return estimate_from_failures(levels, own, run.draws, evaluations)
