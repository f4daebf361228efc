"""The cross-entropy method: draws noise from a Gaussian that is fitted to the worst episodes."""

from collections.abc import Sequence
from math import isfinite
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import astuple
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits, ModeProbability
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome, TrajectorySource
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import UpToOne, UpToTen, archive, robustness_m
from eigenfail_services.statistics.importance import WeightedFailures, explain_nothing_counted

Array = NDArray[np.float64]


class GaussianProposal(msgspec.Struct, frozen=True, eq=False):
    """q(z): z_t ~ N(mean_t, diag(std_t²)), independent in all steps and channels.

    Attributes:
        mean: shape (horizon, channels). [sigma]
        std: shape (horizon, channels), above 0. [sigma]
    """

    mean: Floats
    std: Floats

    def draw(self, count: int, random: np.random.Generator) -> Floats:
        """Draw noise trajectories z, shape (count, horizon, channels). [sigma]"""
        eps = random.standard_normal((count, *self.mean.shape), np.float32)
        return self.mean + self.std * eps


def make_prior(horizon: int, channels: int) -> GaussianProposal:
    """Return p(z) as a proposal: mean 0, standard deviation 1."""
    shape = horizon, channels
    return GaussianProposal(np.zeros(shape, np.float32), np.ones(shape, np.float32))


def log_weights(trajectories: Sequence[Floats], proposal: GaussianProposal) -> Array:
    """Return log p(z) − log q(z) of trajectories drawn from q, shape (n,).

    Each trajectory counts up to its end. This is the whole weight, because the end of an episode at
    a step depends only on the noise up to that step. So episodes of different lengths are
    comparable (Siegmund 1976, Annals of Statistics 4, 673–684).

    Args:
        trajectories: z of each episode, shape (steps, channels), steps no more than the horizon.
            [sigma]
        proposal: proposal that the noise was drawn from.
    """
    return np.array([_log_weight(z.astype(np.float64), proposal) for z in trajectories])


def fit_gaussian(elite: Sequence[Floats], proposal: GaussianProposal) -> tuple[Array, Array]:
    """Return mean and standard deviation of an elite, both of shape (horizon, channels). [sigma]

    After its end, an episode counts as a draw from the prior, as later noise would not have
    mattered. The variance of the running episodes has Bessel's correction; otherwise small elites
    would narrow it in each round. If only one episode still runs, the proposal's variance is kept.

    Args:
        elite: z of each episode, shape (steps, channels); at least one.
        proposal: proposal that the noise was drawn from.
    """
    z, running = _pad(elite, proposal.mean.shape)
    count = running.sum(axis=0)
    # `_pad` has zeros where nothing ran: the sum is that of the steps that ran.
    centre = z.sum(axis=0) / np.maximum(count, 1)
    squares = np.where(running, (z - centre) ** 2, 0.0).sum(axis=0)
    unknown = proposal.std.astype(np.float64) ** 2
    variance = np.where(count > 1, squares / np.maximum(count - 1, 1), unknown)
    share = count / len(elite)
    # Variance of a mixture: of the share that runs about its mean, and of the prior about 0. The
    # last factor also holds the spread between the two means.
    mixed = share * variance + (1.0 - share) * (1.0 + share * centre**2)
    return share * centre, np.sqrt(mixed)


def average_over_steps(values: Array, window: int) -> Array:
    """Return the moving average over a window of steps; values of shape (horizon, channels)."""
    first = np.arange(len(values)) - (window - 1) // 2
    last = np.minimum(first + window, len(values))
    first = np.maximum(first, 0)
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    mean: Array = (sums[last] - sums[first]) / (last - first)[:, None]
    return mean


def _log_weight(z: Array, proposal: GaussianProposal) -> float:
    mean, std = (part[: len(z)].astype(np.float64) for part in (proposal.mean, proposal.std))
    return float(np.sum(0.5 * ((z - mean) / std) ** 2 - 0.5 * z**2 + np.log(std)))


def _pad(elite: Sequence[Floats], shape: tuple[int, ...]) -> tuple[Array, NDArray[np.bool_]]:
    """Return z with zeros after each end, (n, *shape), and a mask of the steps that ran.

    The shape is (horizon, channels).
    """
    z = np.zeros((len(elite), *shape))
    for row, trajectory in zip(z, elite, strict=True):
        row[: len(trajectory)] = trajectory
    ends = np.array([len(trajectory) for trajectory in elite])
    return z, (np.arange(shape[0]) < ends[:, None])[..., None]


def select_elite(
    results: Sequence[EpisodeResult], proposal: GaussianProposal, share: float
) -> list[Floats]:
    """Return the noise of a round's elite; empty if the round is uninformative.

    If there are fewer failures than elite places, the elite are the least robust episodes.
    Otherwise they are the failures with the largest log p(z) − log q(z). With log p(z) alone, the
    smallest noise would be selected even in directions that do not matter, and the proposal would
    become narrower than the failures are. Episodes that tie with the last of the elite belong to
    it. An elite of all episodes is uninformative.

    Args:
        results: results of one round; errored episodes are ignored.
        proposal: proposal that their noise was drawn from.
        share: share of the elite among the episodes that ran; at least one episode.
    """
    ran = [result for result in results if isfinite(robustness_m(result))]
    failures = [result for result in ran if result.is_failure]
    count = max(1, round(share * len(ran)))
    # Once there are enough failures, robustness cannot tell them apart: likelihood decides.
    if len(failures) >= count:
        noise = [result.noise.z for result in failures]
        best = _lowest(noise, -log_weights(noise, proposal), count)
    else:
        noise = [result.noise.z for result in ran]
        best = _lowest(noise, np.array([robustness_m(result) for result in ran]), count)
    return best if len(best) < len(ran) else []


def _lowest(noise: Sequence[Floats], scores: Array, count: int) -> list[Floats]:
    """Return the noise with the `count` lowest scores, and with scores that tie with the last."""
    if not noise:
        return []
    # Ties are kept together: to cut among equals would be to choose by the order of the draws.
    last = np.sort(scores)[count - 1]
    return [z for z, score in zip(noise, scores, strict=True) if score <= last]


ADVICE = (
    "Take method subset, or give it more episodes, larger rounds and no narrower noise: "
    "batch = 200, min_std = 1, mean_smoothing = 0.3."
)


class CemSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `cem`, which starts from the prior: mean 0, standard deviation 1 [sigma].

    With some hundred episodes, many small rounds find more failures than few large rounds. If the
    standard deviation may fall to sqrt(1/2), the variance of importance weights is infinite.
    """

    batch: Annotated[int, Meta(ge=2, le=100_000, description="episodes in a round")] = 20
    elite_share: Annotated[
        float, Meta(gt=0.0, lt=1.0, description="share of a round that is learnt from")
    ] = 0.1
    mean_smoothing: Annotated[
        UpToOne, Meta(description="of the way to the elite's mean, this much is gone")
    ] = 0.7
    std_smoothing: Annotated[UpToOne, Meta(description="the same for the standard deviation")] = 0.3
    min_std: Annotated[UpToOne, Meta(description="smallest standard deviation [sigma]")] = 0.9
    max_std: Annotated[
        float, Meta(ge=1.0, le=10.0, description="largest standard deviation [sigma]")
    ] = 1.0
    max_mean: Annotated[UpToTen, Meta(description="largest |mean| [sigma]")] = 2.0
    mean_window: Annotated[
        int,
        Meta(ge=1, le=10_000, description="steps over which moves of the mean are averaged"),
    ] = 9


class CrossEntropyMethod:
    """Moves a Gaussian of the noise towards failures, and towards likely failures among them.

    Attributes:
        lookahead: 0, as each round depends on all earlier ones.
        proposal: proposal for the next round; see `log_weights`.
    """

    Settings = CemSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays: number of rounds."""

        rounds: int

    traits = MethodTraits(mode_probability=ModeProbability.WEIGHTS, chart_mark=3, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: CemSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._rounds = 0
        self._budget = context.episodes
        self._seen = 0
        self._sums = WeightedFailures()
        self.proposal = make_prior(context.horizon, context.channels)

    @staticmethod
    def round_sizes(settings: CemSettings, _episodes: int) -> RoundSizes:
        """Return the size of a batch for all rounds."""
        return RoundSizes(settings.batch, settings.batch, "batch")

    def propose(self, n: int) -> Proposal:
        """Return a round of draws from the proposal."""
        return self.exploit(min(n, self._settings.batch))

    def exploit(self, n: int) -> Proposal:
        """Return draws from the present proposal."""
        random = np.random.default_rng([self._seed, self._rounds])
        self._rounds += 1
        draws = self.proposal.draw(n, random)
        return Proposal(tuple(TrajectorySource(z) for z in draws))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Move the proposal towards the elite of a round."""
        self._count(results)
        best = select_elite(results, self.proposal, self._settings.elite_share)
        if best:
            self.proposal = self._move_towards(*fit_gaussian(best, self.proposal))

    def _count(self, results: Sequence[EpisodeResult]) -> None:
        """Weight the episodes of the second half of the budget.

        The first half is left out, because the few heavy weights of early rounds would dominate the
        sum.
        """
        if self._seen >= self._budget // 2:
            self._sums = self.weigh(self._sums, results)
        self._seen += len(results)

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """Return the sums with episodes of the present proposal added."""
        ran = [result for result in results if result.outcome is not Outcome.ERRORED]
        failures = [result.noise.z for result in ran if result.is_failure]
        return sums.after(log_weights(failures, self.proposal), len(ran))

    def estimate_from_sums(self, sums: WeightedFailures, _horizon: int) -> Estimate | None:
        """Return the failure probability by importance sampling; None without episodes."""
        return sums.estimate(ADVICE) if sums.episodes else None

    def estimate(self) -> Estimate | None:
        """Return the estimate over the second half of the budget."""
        estimate = self.estimate_from_sums(self._sums, len(self.proposal.mean))
        return estimate or explain_nothing_counted(self._seen, self._budget)

    def state(self) -> bytes:
        """Return proposal, number of rounds, and sums of the weights."""
        arrays: dict[str, archive.Array] = {
            "mean": self.proposal.mean,
            "std": self.proposal.std,
            "sums": np.array([self._seen, *astuple(self._sums)]),
        }
        return archive.write("cem", self._Facts(self._rounds), arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, so that learning continues bit for bit.

        Raises:
            ProtocolError: the bytes do not fit this method and this horizon.
        """
        facts, arrays = archive.read("cem", state, self._Facts)
        shape = self.proposal.mean.shape
        with archive.wrap_errors("cem"):
            mean, std = (archive.take(arrays, name, shape) for name in ("mean", "std"))
            seen, *sums = archive.take(arrays, "sums", (1 + len(astuple(self._sums)),)).tolist()
        self._rounds = facts.rounds
        self._seen, self._sums = int(seen), WeightedFailures(*sums)
        self.proposal = GaussianProposal(mean, std)

    def _move_towards(self, mean: archive.Array, std: archive.Array) -> GaussianProposal:
        """Return the proposal after a step towards the mean and standard deviation of the elite.

        The change of the mean is averaged over steps. Averaging the mean itself would flatten it.
        """
        given, before = self._settings, self.proposal
        move = average_over_steps(mean - before.mean, given.mean_window)
        mean = before.mean + given.mean_smoothing * move
        std = before.std + given.std_smoothing * (std - before.std)
        return GaussianProposal(
            _clip(mean, -given.max_mean, given.max_mean),
            _clip(std, given.min_std, given.max_std),
        )


def _clip(values: archive.Array, low: float, high: float) -> Floats:
    return np.clip(values, low, high).astype(np.float32)
