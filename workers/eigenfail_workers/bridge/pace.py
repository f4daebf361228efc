"""How fast a bridge is, by itself and side by side, against the time that its world takes."""

from time import perf_counter

import msgspec

from eigenfail.cli.checkups import Verdict
from eigenfail.testing.simulation import SEED
from eigenfail_workers.bridge.checks import MOST_BESIDE, courses
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.messages import Start
from eigenfail_workers.bridge.patience import Patience
from eigenfail_workers.bridge.staging import scenario_of


class Pace(msgspec.Struct, frozen=True):
    """What a step takes. [s]

    Attributes:
        dt_s: in its world.
        alone_s: of an episode by itself, its reset shared out among the steps.
        together_s: of several side by side, for all of them.
        beside: how many those are.
    """

    dt_s: float
    alone_s: float
    together_s: float
    beside: int

    def __str__(self) -> str:
        """As people read it."""
        return (
            f"{1e3 * self.alone_s:.3g} ms a step, {self.dt_s / self.alone_s:.3g} × real time; "
            f"{1e3 * self.together_s:.3g} ms for {self.beside} side by side."
        )

    def verdict(self, steps: int, patience: Patience) -> tuple[Verdict, str]:
        """Whether campaigns can live with it, and why."""
        episode_s = steps * self.alone_s
        if episode_s > patience.episode_s:
            said = f"An episode takes {episode_s:.3g} s, and is given up after"
            return Verdict.BROKEN, f"{self} {said} {patience.episode_s:g} s. {patience.remedy}"
        if self.alone_s > self.dt_s:
            return Verdict.SLOW, f"{self} Slower than real time: campaigns will take their time."
        return Verdict.PASSED, str(self)


def pace_of(connection: Connection, start: Start) -> Pace:
    """Measure it, once the bridge has loaded what it needs.

    Raises:
        EpisodeError: the bridge is in trouble.
        InvalidValue: it does not run what it says that it knows.
    """
    beside = min(connection.welcome.slots, MOST_BESIDE)
    dt_s = scenario_of(connection.welcome, start.scenario).dt_s
    step_s(connection, start, 1)
    alone_s, together_s = (step_s(connection, start, many) for many in (1, beside))
    return Pace(dt_s, alone_s, together_s, beside)


def step_s(connection: Connection, start: Start, beside: int) -> float:
    """What a step of so many takes. [s]"""
    began_s = perf_counter()
    found = courses(connection, start, [SEED] * beside)
    return (perf_counter() - began_s) / max(1, *(len(seen) - 1 for seen in found))
