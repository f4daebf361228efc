"""How far the policy may reach while it is trained."""

import msgspec

SHARE = 0.5
"""Of a campaign's episodes, after which the last amplitude is reached and stays."""


class Amplitudes(msgspec.Struct, frozen=True):
    """The largest |z| goes linearly from its first value to its last.

    Attributes:
        first: at the campaign's start. [sigma]
        last: from half of the episodes on, and whenever the policy is only used. [sigma]
        episodes: the campaign's budget.
    """

    first: float
    last: float
    episodes: int

    def at(self, episode: int) -> float:
        """For the round that begins with this episode, counted from 0. [sigma]"""
        if self.settled(episode):
            return self.last
        return self.first + (self.last - self.first) * episode / (SHARE * self.episodes)

    def settled(self, episode: int) -> bool:
        """Whether nothing changes from this episode on."""
        return self.first == self.last or episode >= SHARE * self.episodes
