"""Attempts of a campaign: where a policy finds next to nothing, training starts anew."""

from typing import Annotated

import msgspec
import numpy as np

Count = Annotated[int, msgspec.Meta(ge=0)]

WINDOW = 100
"""Number of the last episodes that show whether training has converged, or is stuck."""

STUCK_SHARE = 0.05
"""Share of failures among them below which an attempt is given up."""

WIDENING = 1.5
"""Factor by which the amplitude grows where nothing has failed."""


class Attempt(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A training from new networks, with an empty replay buffer.

    Attributes:
        number: number of attempts before it.
        first: index of its first episode.
        kept_before: number of episodes that were added to the buffers of earlier attempts.
        widening: its amplitude ÷ the amplitude of the settings.
    """

    number: Count = 0
    first: Count = 0
    kept_before: Count = 0
    widening: float = 1.0

    def derive_seed(self, seed: int) -> int:
        """Return the seed of its networks and batches; that of the learner for the first one."""
        # The first attempt has the learner's own seed: without a restart, nothing differs from a
        # campaign without `patience`.
        if not self.number:
            return seed
        return int(np.random.SeedSequence([seed, self.number]).generate_state(1)[0])


class RestartRule(msgspec.Struct, frozen=True):
    """When an attempt is given up, and what the next one changes.

    Attributes:
        patience: number of episodes after which an attempt may be given up, if as many are left;
            None: never.
        amplitude: amplitude of the settings. [sigma]
        largest_amplitude: bound of the widened amplitude. [sigma]
        episodes: budget of the campaign.
    """

    patience: int | None
    amplitude: float
    largest_amplitude: float
    episodes: int

    def is_stuck(self, attempt: Attempt, observed: int, recent: tuple[bool, ...]) -> bool:
        """Whether an attempt is to be given up.

        Args:
            attempt: the present one.
            observed: number of observed episodes of the campaign.
            recent: whether the last episodes of the attempt failed, at most `WINDOW`.
        """
        if self.patience is None or len(recent) < WINDOW:
            return False
        tried, left = observed - attempt.first, self.episodes - observed
        # With fewer left, another attempt would be given less than the one that has found nothing.
        is_due = tried >= self.patience <= left
        return is_due and sum(recent) < STUCK_SHARE * WINDOW

    def start_next(self, attempt: Attempt, first: int, kept: int, *, found: bool) -> Attempt:
        """Return the attempt after one that was given up.

        Args:
            attempt: the one before.
            first: index of its first episode.
            kept: number of episodes that were added to buffers so far.
            found: whether any episode of the campaign failed; if not, the amplitude is widened.
        """
        widening = attempt.widening if found else self.widen(attempt.widening)
        return Attempt(attempt.number + 1, first, kept, widening)

    def widen(self, widening: float) -> float:
        """Return the next larger widening, within `largest_amplitude`."""
        return max(widening, min(widening * WIDENING, self.largest_amplitude / self.amplitude))
