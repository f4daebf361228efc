"""The failure probability from episodes of policies, each weighed by the one that ran it."""

from collections.abc import Sequence
from statistics import NormalDist

import msgspec

from eigenfail.values import EpisodeResult, Estimate, Policy
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail_services.methods.ast.amplitudes import SHARE
from eigenfail_services.methods.ast.decisions import usable
from eigenfail_services.methods.ast.density import log_weights
from eigenfail_services.statistics.importance import BLIND, WeightedFailures, nothing_counted

ADVICE = (
    "Take method subset, or give it more episodes and a policy that stays more random: "
    "target_entropy = 0.5."
)
_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_policies = msgspec.msgpack.Decoder(dict[int, Policy], dec_hook=decode_array)


class PolicyProbability:
    """Running sums over the rounds of the second half of the budget.

    By then the amplitude rests, and early policies, whose few heavy weights would outweigh all
    others, are over. A policy never depends on the round that it runs, so that the sums stay
    unbiased while it is trained. With hold > 1 there is nothing to weigh: noise that is held lies
    in a set that has probability 0 under p(z).

    Args:
        hold: steps for which an action stays.
        amplitude: the largest |z| in the second half. [sigma]
        budget: of the campaign, in episodes.

    Attributes:
        sums: over the episodes that count.
    """

    def __init__(self, hold: int, amplitude: float, budget: int) -> None:
        self._has_density = hold == 1
        self._amplitude = amplitude
        self._budget = budget
        self._open: dict[int, Policy] = {}
        self.sums = WeightedFailures()

    def begin(self, first: int, policy: Policy) -> None:
        """A round from episode `first` on is to be run under that policy."""
        if self._has_density and first >= SHARE * self._budget:
            self._open[first] = policy

    def end(self, first: int, results: Sequence[EpisodeResult]) -> None:
        """The round from episode `first` on was run."""
        if (policy := self._open.pop(first, None)) is not None:
            self.sums = self.weigh(self.sums, results, policy)

    def weigh(
        self, sums: WeightedFailures, results: Sequence[EpisodeResult], policy: Policy
    ) -> WeightedFailures:
        """The sums with episodes of a policy; as they are where its noise is held."""
        if not self._has_density:
            return sums
        ran = [result for result in results if usable(result)]
        failures = [result for result in ran if result.is_failure]
        return sums.after(log_weights(failures, policy), len(ran))

    def tell(self, sums: WeightedFailures, horizon: int) -> Estimate | None:
        """The probability that such sums tell; None over no episode."""
        note = f"{reach(self._amplitude, horizon)} {BLIND}"
        return sums.estimate(ADVICE, note) if sums.episodes else None

    def estimate(self, seen: int, horizon: int) -> Estimate | None:
        """The same of the campaign's own sums, after so many episodes; None where noise is held."""
        if not self._has_density:
            return None
        return self.tell(self.sums, horizon) or nothing_counted(seen, self._budget)

    def open(self) -> bytes:
        """The policies of the rounds that are being run."""
        return _encoder.encode(self._open)

    def load(self, sums: WeightedFailures, policies: dict[int, Policy]) -> None:
        """Go on from there."""
        self.sums, self._open = sums, policies


def read_open(data: bytes) -> dict[int, Policy]:
    """What `open` gave; none of states that were written before there were estimates.

    Raises:
        ValueError: these are no policies.
    """
    return _policies.decode(data) if data else {}


def reach(amplitude: float, horizon: int) -> str:
    """What noise the policy cannot choose, and how much the rest is of all, in words."""
    share = (2.0 * NormalDist().cdf(amplitude) - 1.0) ** (2 * horizon)
    return (
        f"A lower bound: it counts failures whose noise stays within ±{amplitude:g} sigma at every "
        f"step, as {100.0 * share:.3g} % of all noise does over {horizon} steps."
    )
