"""Of what the model of scale is made: a method, what things cost, who works."""

from math import inf

import msgspec

GROUP_S, GROUP = 0.05, 1_000
"""A group is committed when its first result has waited so long, or there are so many."""

TURN = 2_000
"""So many results at most are taken in one turn, all that have come, and then committed."""


class Method(msgspec.Struct, frozen=True):
    """How a method goes from round to round.

    Attributes:
        round_size: episodes of a round.
        lookahead: how many rounds may be open besides the oldest.
        learn_s: processor time of its learner for a round, whatever its size. [s]
        learn_episode_s: and for each of its episodes. [s]
        checkpoint_s: what the hub takes to keep a checkpoint. [s]
    """

    round_size: int
    lookahead: int
    learn_s: float = 0.0
    learn_episode_s: float = 0.0
    checkpoint_s: float = 0.0

    @property
    def round_s(self) -> float:
        """What the learner takes for a whole round."""
        return self.learn_s + self.round_size * self.learn_episode_s


class Costs(msgspec.Struct, frozen=True):
    """What the hub does with its one thread, and what travels and is kept.

    Attributes:
        result_s: to take in a result, lease another episode, and write both down. [s]
        commit_s: of a transaction, whatever it holds. [s]
        heartbeat_s: to answer one; each worker sends one a second. [s]
        wire_bytes: of a result, its lease and its acknowledgement.
        disk_bytes: of a result in the database.
        wire_bytes_per_s: of the hub's network.
        disk_bytes_per_s: of the database's disk.
    """

    result_s: float = 0.0
    commit_s: float = 0.0
    heartbeat_s: float = 0.0
    wire_bytes: float = 0.0
    disk_bytes: float = 0.0
    wire_bytes_per_s: float = inf
    disk_bytes_per_s: float = inf


class WorkerPool(msgspec.Struct, frozen=True):
    """A number of workers, and the time that each of them takes for an episode. [s]"""

    workers: int
    episode_s: float
