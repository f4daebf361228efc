"""The replay buffer of the numpy trainer."""

import numpy as np

from eigenfail.values import Floats
from eigenfail_services.methods.archive import Array, Arrays, take
from eigenfail_services.methods.ast.decisions import Decisions

KEPT = ("states", "actions", "rewards", "next_states", "ends")


class Memory:
    """A ring of transitions.

    Args:
        size: how many are kept; the oldest make room.
        states: number of a state's components.
        actions: number of an action's components.
    """

    def __init__(self, size: int, states: int, actions: int) -> None:
        widths = {"states": (states,), "next_states": (states,), "actions": (actions,)}
        self._rings = {name: np.zeros((size, *widths.get(name, ())), np.float32) for name in KEPT}
        self._size = size
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, self._size)

    def add(self, decisions: Decisions) -> None:
        """Keep transitions."""
        count = len(decisions.rewards)
        places = np.arange(self._added, self._added + count) % self._size
        for name, ring in self._rings.items():
            ring[places] = getattr(decisions, name)
        self._added += count

    def take(self, rows: Array) -> Decisions:
        """The transitions of these rows."""
        picked: dict[str, Floats] = {name: ring[rows] for name, ring in self._rings.items()}
        return Decisions(**picked)

    def arrays(self, prefix: str) -> dict[str, Array]:
        """What is kept, by name."""
        kept = {f"{prefix}.{name}": ring[: len(self)] for name, ring in self._rings.items()}
        return {**kept, f"{prefix}.added": np.array([self._added], np.int64)}

    def load(self, prefix: str, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self._added = int(take(arrays, f"{prefix}.added", (1,))[0])
        for name, ring in self._rings.items():
            shape = (len(self), *ring.shape[1:])
            ring[: len(self)] = take(arrays, f"{prefix}.{name}", shape)
