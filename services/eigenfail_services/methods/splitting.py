"""Adaptive multilevel splitting: continues episodes that come close to a collision."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.errors import InvalidValue, LearnerFailed
from eigenfail.values import episode
from eigenfail.values.arrays import Floats
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Proposal
from eigenfail_services.methods import RoundSize, archive
from eigenfail_services.methods.batch_learner import limit_round
from eigenfail_services.statistics import multilevel_splitting
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.pooled_estimate import estimate_from_draws
from eigenfail_services.statistics.subset_simulation import PlainCounts

BY = "multilevel splitting"

FEWEST_PARTICLES = 20
"""Episodes of a run below which nearly every run dies out."""

EPISODES_PER_PARTICLE = 16
"""Episodes that a run takes for each of those that it holds, down to P = 1e-6: 1 + log(1 / P), and
a margin, since a level gives up whole ties."""

FEWEST_FAMILIES = 2.5
"""Effective number of families below which nothing is printed: fewer do not show their own spread.
A larger limit prints less that is right: where the importance misleads, an estimate above P comes
from a few large families. Of 200 campaigns on the walk of `benchmarks/truth/course_problems.py`
that fails at its end alone (tuning seeds, 20 episodes a run) 94 % of the printed intervals held P
with this limit, 93 % with 3, and the mean of the estimates was 0.87 P and 0.84 P."""


MISLED = (
    "Probably it peaks at something that decides no failure: take another `importance`, or method "
    "subset or monte_carlo."
)


class SplittingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `splitting`."""

    runs: Annotated[
        int, Meta(ge=5, le=100, description="independent runs, of which the estimate is the mean")
    ] = 10
    particles: Annotated[
        Annotated[int, Meta(ge=FEWEST_PARTICLES, le=100_000)] | None,
        Meta(
            description="episodes that a run holds; none given: what the budget allows down to "
            "P = 1e-6"
        ),
    ] = None
    given_up: Annotated[
        float, Meta(gt=0.0, le=0.5, description="share of them that is given up at a level")
    ] = 0.1
    importance: Annotated[
        episode.Importance,
        Meta(
            description="what tells how close an episode is to a collision: `required_braking`, "
            "`time_to_collision` or `distance`"
        ),
    ] = episode.Importance.REQUIRED_BRAKING
    round_size: RoundSize = 10_000

    def choose_particles(self, episodes: int) -> int:
        """Return the number of episodes that each run holds."""
        return self.particles or episodes // (self.runs * EPISODES_PER_PARTICLE)

    def check_budget(self, episodes: int) -> None:
        """Raise InvalidValue if the budget allows too few episodes in each run."""
        chosen = self.choose_particles(episodes)
        if chosen < FEWEST_PARTICLES or episodes < self.runs * chosen:
            fewest = self.runs * max(self.particles or 0, FEWEST_PARTICLES) * EPISODES_PER_PARTICLE
            raise InvalidValue(
                "episodes",
                f"{episodes} are too few for {self.runs} runs; they take {fewest}.",
                "Give more episodes, or take fewer runs: 5 at least.",
            )


class MultilevelSplitting:
    """Runs several independent splittings in parallel, one level of all runs at a time.

    If the ended runs give no number, the rest of the budget is drawn from p(x). The share of
    failures among these draws is unbiased, and its interval is exact.

    Attributes:
        lookahead: 0, as each level depends on the one before.

    Raises:
        InvalidValue: the budget is too small.
    """

    Settings = SplittingSettings
    traits = MethodTraits(
        bounds_probability=True, learns=False, needs_course=True, chart_mark=13, references={}
    )
    kind = "splitting"
    lookahead = 0

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides the arrays.

        Attributes:
            proposed: number of proposed episodes of the wave.
            episodes_run: number of episodes that ran so far.
            errored: number of errored episodes so far.
            failed: failure flags of the wave's episodes with a result.
            lost: error flags of the same episodes.
            counts: counts of each run.
            plain: counts of the draws from p(x) after the end of all runs.
        """

        proposed: Annotated[int, Meta(ge=0)]
        episodes_run: int
        errored: int
        failed: tuple[bool, ...]
        lost: tuple[bool, ...]
        counts: tuple[multilevel_splitting.SplittingCounts, ...]
        plain: PlainCounts

    def __init__(self, context: LearnerContext, settings: SplittingSettings) -> None:
        settings.check_budget(context.episodes)
        self._settings = settings
        self._budget = context.episodes
        self._horizon = context.horizon
        self._round_size = limit_round(context, settings.round_size)
        particles = settings.choose_particles(context.episodes)
        shape = particles, context.horizon, context.channels
        self._runs = [
            multilevel_splitting.SplittingRun((context.seed, number), shape, settings.given_up)
            for number in range(settings.runs)
        ]
        self._proposed, self._episodes_run, self._errored = 0, 0, 0
        self._wave = self._join_waves()
        self._importances: list[Floats | None] = []
        self._failed: list[bool] = []
        self._plain = PlainCounts()

    def _join_waves(self) -> Floats:
        """Return the next episodes of all runs; empty after their end or an unfaithful episode."""
        waves = [run.wave.z for run in self._runs if run.wave is not None]
        if self._count_unfaithful():
            # One unfaithful episode shows that the simulation does not repeat itself, and every
            # estimate by continued episodes would be wrong: the runs stop at once.
            waves = []
        return np.concatenate(waves) if waves else self._runs[0].z[:0]

    def _count_unfaithful(self) -> int:
        return sum(run.counts.unfaithful for run in self._runs)

    def propose(self, n: int) -> Proposal:
        """Return the rest of the present level of all runs, at most a round.

        After the end of all runs: plain draws if the runs give no number, otherwise nothing.
        """
        count = min(n, self._round_size)
        if not len(self._wave):
            return self._propose_plain(count)
        chosen = self._wave[self._proposed : self._proposed + count]
        self._proposed += len(chosen)
        importance = self._settings.importance
        return Proposal(tuple(episode.TrajectorySource(z, importance) for z in chosen))

    def _propose_plain(self, n: int) -> Proposal:
        left = self._budget - self._count_seen() - self._proposed
        count = min(n, left) if self._explain_refusal() else 0
        self._proposed += count
        return Proposal((episode.PriorSource(),) * count)

    def _count_seen(self) -> int:
        """Return the number of episodes with a result, including errored ones and plain draws."""
        return self._episodes_run + self._errored + self._plain.draws

    def observe(self, results: Sequence[episode.EpisodeResult]) -> None:
        """Add the results of episodes. A complete level leads to the next one.

        Raises:
            LearnerFailed: the importance of an episode is missing.
        """
        if not len(self._wave):
            self._count_plain(results)
            return
        for result in results:
            is_lost = result.outcome is episode.Outcome.ERRORED
            if not is_lost and result.importance is None:
                raise LearnerFailed(
                    f"Episode {result.index} came without the importance of its steps.",
                    "Run workers of the same release as the controller.",
                )
            # A lost episode keeps its place: results belong to the rows of the wave by their order.
            self._importances.append(None if is_lost else result.importance)
            self._failed.append(result.is_failure)
            self._errored += is_lost
            self._episodes_run += not is_lost
        if len(self._failed) == len(self._wave):
            self._finish_wave()

    def _count_plain(self, results: Sequence[episode.EpisodeResult]) -> None:
        before = self._plain
        self._plain = PlainCounts(
            before.draws + len(results),
            before.failures + sum(result.is_failure for result in results),
            before.errored + sum(result.outcome is episode.Outcome.ERRORED for result in results),
        )
        self._proposed -= len(results)

    def _finish_wave(self) -> None:
        first = 0
        for run in self._runs:
            if run.wave is not None:
                end = first + len(run.wave.rows)
                run.add(self._importances[first:end], self._failed[first:end])
                first = end
        self._wave = self._join_waves()
        self._proposed, self._importances, self._failed = 0, [], []

    def estimate(self) -> Estimate | None:
        """Return the failure probability; before the end of all runs, why it is missing."""
        episodes = self._episodes_run
        if problem := self._explain_refusal():
            refused = Estimate(by=BY, episodes=episodes, problem=problem)
            # Only once the budget is spent: to stop at a failure would make the share too large.
            has_drawn = self._plain.draws and self._count_seen() == self._budget
            return estimate_from_draws(refused, self._plain) if has_drawn else refused
        pooled = self._pool()
        return Estimate(
            by=BY,
            episodes=episodes,
            probability=pooled.probability,
            cv=pooled.cv,
            interval=log_normal(pooled.probability, pooled.cv, pooled.families),
            effective=pooled.families,
            note=self._describe(pooled),
        )

    def _pool(self) -> multilevel_splitting.PooledRuns:
        """Return the mean of the runs that have ended."""
        parts = [run.divide_by_families() for run in self._runs]
        return multilevel_splitting.pool_runs([one for one in parts if one is not None])

    def _explain_refusal(self) -> str:
        """Return why the estimate is missing; empty if it exists."""
        if unfaithful := self._count_unfaithful():
            return (
                f"{unfaithful} episodes did not repeat the course of the episode that they "
                "continue. Splitting needs a simulation whose course follows from the noise alone: "
                "take method subset."
            )
        count = len(self._runs)
        ended = sum(run.wave is None for run in self._runs)
        if ended < count:
            return (
                f"{ended} of {count} runs have reached failures or died out. Where "
                "the budget is spent, failures are rarer than it allows for: give more episodes, "
                "or set fewer `particles`."
            )
        return self._explain_doubt(self._pool())

    def _explain_doubt(self, pooled: multilevel_splitting.PooledRuns) -> str:
        """Return why the estimate of ended runs is not printed; empty if it is printed."""
        count, held = len(self._runs), len(self._runs[0].z)
        died = count - pooled.reached
        importance = self._settings.importance.value
        if not pooled.reached:
            return (
                f"All {count} runs died out, each with {held} episodes: their importance "
                f"`{importance}` rose no further before a failure. {MISLED} More episodes "
                "alone hardly help."
            )
        if 2 * pooled.reached <= count:
            return (
                f"{died} of {count} runs died out: their importance `{importance}` rose no further "
                f"before a failure. {MISLED} If a run holds few episodes (here {held}), "
                "more episodes help too."
            )
        if pooled.families < FEWEST_FAMILIES:
            return (
                "The failures descend from few of the first episodes: they are worth "
                f"{pooled.families:.1f} independent ones, and {FEWEST_FAMILIES} are needed. "
                f"Give it more episodes: each run holds {held}. Or take another `importance`."
            )
        return ""

    def _describe(self, pooled: multilevel_splitting.PooledRuns) -> str:
        """Return the note that explains the estimate to readers."""
        died = len(self._runs) - pooled.reached
        return (
            f"Mean of {len(self._runs)} independent runs. "
            f"{f'{died} of them died out and count as 0. ' if died else ''}"
            f"The failures descend from first episodes that are worth {pooled.families:.1f} "
            "independent ones: from these and from the differences between the runs follows the "
            "interval. "
            "The estimate is more often too low than too high. "
            "Kinds of failure that few episodes come near may be missing in all of the runs."
        )

    def state(self) -> bytes:
        """Return the episodes of all runs, and the results of the open level."""
        known = [
            # Importances differ in length: an archive holds whole arrays, and `steps` cuts them
            # again.
            np.zeros(self._horizon, np.float32)
            if one is None
            else np.pad(one, (0, self._horizon - len(one)))
            for one in self._importances
        ]
        arrays: dict[str, archive.Array] = {
            "z": np.stack([run.z for run in self._runs]),
            "courses": np.stack([run.courses for run in self._runs]),
            "families": np.stack([run.families for run in self._runs]),
            "importances": np.reshape(known, (len(known), self._horizon)).astype(np.float32),
            "steps": np.array(
                [0 if one is None else len(one) for one in self._importances], np.int64
            ),
        }
        facts = self._Facts(
            self._proposed,
            self._episodes_run,
            self._errored,
            tuple(self._failed),
            tuple(one is None for one in self._importances),
            tuple(run.counts for run in self._runs),
            self._plain,
        )
        return archive.write(self.kind, facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, so that the runs continue bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read(self.kind, state, self._Facts)
        runs, first = len(self._runs), self._runs[0]
        with archive.wrap_errors(self.kind):
            z = archive.take(arrays, "z", (runs, *first.z.shape))
            courses = archive.take(arrays, "courses", (runs, *first.courses.shape))
            families = archive.take(arrays, "families", (runs, len(first.z)))
            if not ((families >= 0) & (families < len(first.z))).all():
                raise ValueError("an episode descends from none of the first ones")
            received = len(facts.failed)
            importances = archive.take(arrays, "importances", (received, self._horizon))
            steps = archive.take(arrays, "steps", (received,)).tolist()
            if not all(0 <= one <= self._horizon for one in steps):
                raise ValueError("a result has more steps than an episode")
            if len(facts.lost) != received or received > facts.proposed:
                raise ValueError(f"there are {received} results of {facts.proposed} episodes")
            for run, *held in zip(self._runs, z, courses, families, facts.counts, strict=True):
                run.restore(*held)
        self._wave = self._join_waves()
        self._proposed, self._episodes_run = facts.proposed, facts.episodes_run
        self._errored, self._failed = facts.errored, list(facts.failed)
        self._plain = facts.plain
        self._importances = [
            None if is_lost else row[:count]
            for row, count, is_lost in zip(importances, steps, facts.lost, strict=True)
        ]
