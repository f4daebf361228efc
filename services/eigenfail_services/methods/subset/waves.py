"""Subset simulations side by side that wait for the robustness of what they ask to be run."""

from collections.abc import Sequence

import numpy as np

from eigenfail_services.statistics.conditional_sampling import Array
from eigenfail_services.statistics.subset_estimate import SubsetEstimate, SubsetSettings
from eigenfail_services.statistics.subset_simulation import SubsetSimulation


class Dialogue:
    """One subset simulation, run from wave to wave.

    Attributes:
        simulation: what is known on the way.
        asked: noise z that waits to be run, shape (n, steps, 2); none once it has ended.
        found: its estimate, once it has ended.
    """

    def __init__(self, steps: int, settings: SubsetSettings, seed: Sequence[int]) -> None:
        self.simulation = SubsetSimulation(steps, settings, seed)
        self._running = self.simulation.run()
        self.asked: Array = next(self._running)
        self.found: SubsetEstimate | None = None

    def tell(self, robustness: Array) -> None:
        """The robustness of all that it asked for, NaN where it could not be run, shape (n,)."""
        if self.found is not None:
            return
        try:
            self.asked = self._running.send(robustness)
        except StopIteration as end:
            self.found, self.asked = end.value, self.asked[:0]


class Waves:
    """Several simulations whose noise is run together, in waves that may come in pieces.

    Attributes:
        dialogues: one for each simulation.
        robustness: of all that was run so far, in order, NaN where it could not be. [m]
        wave: what all of them ask for now, shape (n, steps, 2); none once all have ended.
        proposed: how much of the wave was handed out.
    """

    def __init__(self, dialogues: Sequence[Dialogue]) -> None:
        self.dialogues = tuple(dialogues)
        self.robustness: list[float] = []
        self._open()

    def next(self, n: int) -> Array:
        """At most n of what is left of the wave, shape (up to n, steps, 2)."""
        chosen = self.wave[self.proposed : self.proposed + n]
        self.proposed += len(chosen)
        return chosen

    def hear(self, robustness: Sequence[float]) -> None:
        """What came of the next ones, in order, over as many waves as they fill.

        Raises:
            ValueError: all simulations have ended before.
        """
        for value in robustness:
            if not len(self.wave):
                raise ValueError("there are more episodes than the simulations asked for")
            self.robustness.append(value)
            self._told.append(value)
            if len(self._told) == len(self.wave):
                self._answer(np.array(self._told))

    def _open(self) -> None:
        self.wave: Array = np.concatenate([one.asked for one in self.dialogues])
        self.proposed = 0
        self._told: list[float] = []

    def _answer(self, told: Array) -> None:
        ends = np.cumsum([len(one.asked) for one in self.dialogues])[:-1]
        for one, values in zip(self.dialogues, np.split(told, ends), strict=True):
            one.tell(values)
        self._open()
