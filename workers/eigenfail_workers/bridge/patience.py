"""How long a worker waits for its bridge: all of it follows from the wall time of an episode."""

from collections.abc import Iterator

import msgspec

from eigenfail.bridges import EPISODE_OPTION
from eigenfail_workers.episode_limit import read_episode_limit

HELLO_S = 10.0
MARGIN_S = 10.0
SHORTEST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 2.0


class Patience(msgspec.Struct, frozen=True):
    """What may take how long. [s]

    Attributes:
        limit_s: of an episode, after which the process that asks the bridge is killed.
        episode_s: of an episode, after which it is given up; as often as much side by side.
        answer_s: of an answer.
        hello_s: of the answer to a hello: so long a bridge may take to come up.
    """

    limit_s: float
    episode_s: float
    answer_s: float
    hello_s: float

    @property
    def remedy(self) -> str:
        """What to do about a bridge that takes too long."""
        return (
            "Make it faster, or its episodes shorter, or give the worker a longer "
            f"{EPISODE_OPTION} than {self.limit_s:g} s."
        )


def patience_of(limit_s: float) -> Patience:
    """What follows from the wall time of an episode. [s]"""
    margin_s = min(MARGIN_S, limit_s / 6.0)
    return Patience(limit_s, limit_s - margin_s, limit_s / 2.0, min(HELLO_S, limit_s / 6.0))


def patience_of_this_worker() -> Patience:
    """That which its parent, or whoever examines a bridge, has told this process.

    Raises:
        InvalidValue: the variable is no number of seconds.
    """
    return patience_of(read_episode_limit())


def pauses() -> Iterator[float]:
    """Before each further try, twice as long as before the last. [s]"""
    pause_s = SHORTEST_PAUSE_S
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
