"""An engine that runs one episode after the other, asked as one that runs several side by side."""

from eigenfail.contracts import EpisodeEngine, LockstepEngine
from eigenfail.values import EpisodeResult, EpisodeTask


class OneByOne:
    """Implements `LockstepEngine` with room for one episode."""

    def __init__(self, engine: EpisodeEngine) -> None:
        self._engine = engine
        self._begun: list[EpisodeTask] = []
        self.learn = engine.learn
        self.run = engine.run
        self.close = engine.close

    @property
    def room(self) -> int:
        """One, while there is none."""
        return 1 - len(self._begun)

    def begin(self, task: EpisodeTask) -> None:
        """Keep it for the turn."""
        self._begun.append(task)

    def turn(self) -> list[EpisodeResult]:
        """Run it."""
        begun, self._begun = self._begun, []
        return list(self._engine.run(begun))


def side_by_side(engine: EpisodeEngine) -> LockstepEngine:
    """The engine itself, if it can run several; else one that asks it for one at a time."""
    return engine if isinstance(engine, LockstepEngine) else OneByOne(engine)
