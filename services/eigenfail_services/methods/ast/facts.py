"""What a learner of `ast` knows besides arrays."""

from collections.abc import Sequence
from typing import Annotated

import msgspec

from eigenfail_services.statistics.importance import WeightedFailures

Count = Annotated[int, msgspec.Meta(ge=0)]

WINDOW = 100
"""Episodes that convergence is judged by."""


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counters, and how the last episodes ended.

    Attributes:
        version: of the policy; it rises with each training, and with each change of amplitude.
        trainings: how often gradient steps were taken.
        amplitude: of that version. [sigma]
        proposed: episodes, all of them.
        observed: episodes, those that could not be run included.
        kept: episodes in the replay buffer, or once in it.
        trained: those of them that gradient steps have followed.
        fresh: decisions not yet trained on.
        recent: whether they failed, of the last episodes learnt from.
        converged: training has ended.
        sums: of the weights of failures, where they have any.
        under: the policies of the rounds that are open and will be weighed, encoded.
    """

    amplitude: float
    version: Count = 0
    trainings: Count = 0
    proposed: Count = 0
    observed: Count = 0
    kept: Count = 0
    trained: Count = 0
    fresh: Count = 0
    recent: tuple[bool, ...] = ()
    converged: bool = False
    sums: WeightedFailures = WeightedFailures()
    under: bytes = b""

    def reaching(self, amplitude: float) -> "Facts":
        """With that amplitude, in a version of its own: workers keep one as it first came."""
        if amplitude == self.amplitude:
            return self
        return msgspec.structs.replace(self, version=self.version + 1, amplitude=amplitude)

    def after(self, failed: Sequence[bool]) -> "Facts":
        """Once these episodes have been learnt from."""
        recent = (*self.recent, *failed)[-WINDOW:]
        return msgspec.structs.replace(self, kept=self.kept + len(failed), recent=recent)

    def fails_in(self, share: float) -> bool:
        """Whether at least that share of the last 100 episodes failed."""
        return len(self.recent) == WINDOW and sum(self.recent) >= share * WINDOW
