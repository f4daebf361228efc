"""The open rounds of one campaign: who is asked for their results, and which of these count."""

from collections import Counter
from collections.abc import Callable, Iterable

import msgspec

from eigenfail.contracts import Store
from eigenfail.values import EpisodeResult, Policy, Round, Shape
from eigenfail.values.records import Verdict
from eigenfail_services.hub.flight import Flight
from eigenfail_services.hub.leases import Leases
from eigenfail_services.store.judging import storable

MAX_REFUSALS = 3


class OpenRounds:
    """Has the episodes of rounds run; what is learnt from is what the store keeps, nothing else.

    Args:
        campaign: by its id.
        shape: of its noise.
        store: where results are kept.
        leases: of all campaigns.

    Attributes:
        problem: why the rounds cannot become whole; empty while they can.
    """

    def __init__(self, campaign: int, shape: Shape, store: Store, leases: Leases) -> None:
        self.problem = ""
        self._campaign = campaign
        self._shape = shape
        self._store = store
        self._leases = leases
        self._flight = Flight()
        self._to_look_up: set[int] = set()
        self._refused = Counter[int]()
        self._landings: dict[Verdict, Callable[[EpisodeResult], None]] = {
            Verdict.KEPT: self._count,
            Verdict.DUPLICATE: self._look_up,
            Verdict.ALARM: self._look_up,
            Verdict.UNWANTED: self._offer_again,
        }

    def open(self, rounds: Iterable[Round]) -> None:
        """Offer the episodes of new rounds to workers, but for those that have a result.

        Raises:
            StoreUnavailable: nothing is open that was not before.
        """
        rounds = tuple(rounds)
        indices = [task.index for task in self._flight.new(rounds)]
        finished = self._store.episodes.finished(self._campaign, indices)
        # Only now, when the store can no longer be away: a round takes off once.
        tasks = self._flight.take_off(rounds)
        known = {result.index for result in finished}
        self._leases.offer(self._campaign, tuple(task for task in tasks if task.index not in known))
        for result in finished:
            self._flight.land(result)

    def land(self, result: EpisodeResult, verdict: Verdict) -> None:
        """A result was judged."""
        self._landings[verdict](result)

    def count_those_kept(self) -> int:
        """Of episodes whose result came twice, the one that the store has; how many it had.

        Raises:
            StoreUnavailable: they are counted at the next call.
        """
        if not self._to_look_up:
            return 0
        kept = self._store.episodes.finished(self._campaign, self._to_look_up)
        for result in kept:
            self._count(result)
        self._to_look_up.clear()
        return len(kept)

    def whole(self) -> tuple[EpisodeResult, ...] | None:
        """The results of the oldest round if all are there; it is closed by this."""
        return self._flight.whole()

    def awaited(self) -> int:
        """How many results open rounds wait for."""
        return self._flight.open()

    def policy(self, version: int) -> Policy:
        """A policy that an open round needs.

        Raises:
            KeyError: none of them does.
        """
        return self._flight.policy(version)

    def _count(self, result: EpisodeResult) -> None:
        # It may have been proposed after it was brought, while its commit was still to come.
        self._leases.settle(self._campaign, result.index, wall_s=0.0)
        # As the store keeps it: a learner that begins again is shown what was read from there.
        kept = storable(result, self._shape)
        self._flight.land(msgspec.structs.replace(kept, scene=None))

    def _look_up(self, result: EpisodeResult) -> None:
        """It is a second one. If the first came to another hub, that one is learnt from."""
        if self._flight.awaited(result.index) is not None:
            self._to_look_up.add(result.index)

    def _offer_again(self, result: EpisodeResult) -> None:
        """What the store does not take leaves its episode open, but not for ever."""
        task = self._flight.awaited(result.index)
        if task is None:
            return
        self._refused[result.index] += 1
        if self._refused[result.index] < MAX_REFUSALS:
            self._leases.offer(self._campaign, (task,))
            return
        self.problem = (
            f"The result of episode {result.index} was refused {MAX_REFUSALS} times: its seed, "
            "steps or shapes are not those of this campaign. Install the same eigenfail, and the "
            "same plug-ins, on all workers."
        )
