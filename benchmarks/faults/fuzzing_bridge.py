"""Bent answers of a bridge at the engine of a worker.

`python -m benchmarks.faults.fuzzing_bridge --messages 1000000` prints what escaped.
"""

from collections import deque
from collections.abc import Iterator
from random import Random
from types import MappingProxyType
from typing import Annotated, Any

import typer
from benchmarks.faults.invalid_messages import BENDS
from msgspec.msgpack import decode, encode

from eigenfail.errors import EpisodeError
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup, EpisodeTask, PriorSource
from eigenfail.values.requirements import Formula
from eigenfail_workers.accounts import RecordedStep
from eigenfail_workers.bridge.connection import Connection, SharedConnection, make_timeouts
from eigenfail_workers.bridge.engine import BridgeEngine
from eigenfail_workers.bridge.messages import BridgeMessage, read_answer
from eigenfail_workers.bridge.messages import encode as encode_request

SEED = 20261127
MESSAGES = 100_000
SLOTS = 3
STEPS = 6
BENT = 0.5
"""Share of the answers that are bent: without true ones no episode would go on."""

WELCOME = MappingProxyType(
    {
        "type": "welcome",
        "protocol": 2,
        "name": "played",
        "version": "1",
        "slots": SLOTS,
        "scenarios": [{"name": "road", "dt_s": 0.1, "steps": STEPS, "parameters": {"gap_m": 9.0}}],
        "planners": [{"name": "driver", "settings": {"headway_s": 1.0}}],
        "channels": ["longitudinal", "lateral", "ghost", "delay", "every.speed"],
        "signals": [{"name": "gap_m", "unit": "m"}],
    }
)
SETUP = EpisodeSetup(
    "bridge",
    "road",
    {"steps": STEPS, "gap_m": 8.0},
    "driver",
    {"headway_s": 0.9},
    DisturbanceModel(
        channels=(
            Channel("lateral"),
            Channel("ghost"),
            Channel("delay"),
            Channel("vehicle_2.speed"),
        )
    ),
    scene_every=1,
    requirements=(Formula(formula="always (bridge.gap_m > 0)"),),
)


def observe(step: int) -> dict[str, Any]:
    """An observation with all that there may be; at step 2 a second vehicle enters."""
    at_m = 2.0 * step
    others = [[20.0 + at_m, 0.0, 0.0, 15.0, 4.5, 1.8], [40.0, 4.0, 0.0, 10.0, 4.5, 1.8]]
    present = 1 if step < 2 else 2
    seen = {
        "step": step,
        "ego": [at_m, 0.0, 0.0, 20.0, 12.0, 2.5],
        "others": others[:present],
        "ids": ["a", "b"][:present],
        "kinds": ["car", "pedestrian"][:present],
        "signals": {"gap_m": 11.75 - step},
        "ended": step == STEPS,
    }
    decided = {
        "perceived": [20.0 + at_m, 0.25],
        "control": [-1.0, 0.0],
        "applied": [-1.0, 0.0],
        "account": {"heeds": "lead", "gap_m": 11.75, "sure": True},
        "path": [[at_m, 0.0], [at_m + 20.0, 0.0]],
    }
    road = {"road": [[[0.0, 2.0], [50.0, 2.0], [90.0, 9.0]], [[0.0, -2.0], [90.0, 5.0]]]}
    return seen | (decided if step else road)


class FakeConnection(Connection):
    """A session with a bridge that is played in this process, and whose answers are bent.

    Args:
        random: chooses what is bent, and how.

    Attributes:
        bent: share of the answers that are bent.
        bent_answers: number of answers that were bent so far.
    """

    def __init__(self, random: Random) -> None:
        self.address, self.session, self.timeouts = "played", "0" * 32, make_timeouts(60.0)
        self.welcome = read_answer(encode(dict(WELCOME)))
        self.bent_answers = 0
        self.bent = BENT
        self._random = random
        self._last_id = 0
        self._steps: dict[int, int] = {}
        self._asked: deque[dict[str, Any]] = deque()

    @property
    def is_alive(self) -> bool:
        """Whether no disconnection has been noticed."""
        return True

    def send(self, request: BridgeMessage) -> None:
        """Take a request in."""
        self._asked.append(decode(encode_request(request)))

    def _receive(self, _within_s: float) -> bytes:
        """Return the answer to the oldest request, bent or not."""
        asked = self._asked.popleft()
        slots = [self._answer(asked["type"], each["slot"]) for each in asked["slots"]]
        answer = encode({"type": "observations", "id": asked["id"], "slots": slots})
        if self._random.random() >= self.bent:
            return answer
        self.bent_answers += 1
        return self._random.choice(BENDS)(self._random, answer)

    def _answer(self, kind: str, slot: int) -> dict[str, Any]:
        self._steps[slot] = 0 if kind == "reset" else self._steps[slot] + 1
        return observe(self._steps[slot])

    def drop(self) -> None:
        """Forget the requests that were not answered."""
        self._asked.clear()


class FakeSessions(SharedConnection):
    """Opens the same played session again and again."""

    def __init__(self, played: FakeConnection) -> None:
        self.address, self.timeouts = played.address, played.timeouts
        self._played = played
        self._connection = None
        self._was_reachable = True

    def _open(self, _until_s: float) -> FakeConnection:
        return self._played


def at_the_engine(n: int = MESSAGES, seed: int = SEED) -> tuple[tuple[str, ...], bool]:
    """Let an engine of a worker have n bent answers.

    Returns:
        The exceptions that left the engine, as text, and whether it runs an episode afterwards.
    """
    played = FakeConnection(Random(seed))
    recorded: list[RecordedStep] = []
    engine = BridgeEngine(SETUP, FakeSessions(played), recorded)
    escapes: list[str] = []
    begun = 0
    while played.bent_answers < n:
        try:
            while engine.room:
                begun += 1
                engine.begin(EpisodeTask(begun, begun, PriorSource()))
            engine.turn()
        except Exception as error:  # noqa: BLE001 - it is what is looked for
            escapes.append(f"{type(error).__name__}: {error}")
    engine.close()
    escapes += bend_welcomes(n // 10, seed)
    return tuple(escapes), _is_served(played)


def _is_served(played: FakeConnection) -> bool:
    """Return whether a new engine runs an episode to its end."""
    played.drop()
    played.bent = 0.0
    (result,) = BridgeEngine(SETUP, FakeSessions(played)).run([EpisodeTask(0, 1, PriorSource())])
    return result.fault is None and result.steps == STEPS


def bend_welcomes(n: int, seed: int = SEED) -> Iterator[str]:
    """Yield what n bent welcomes raise that is no error of an episode."""
    random, true = Random(seed), encode(dict(WELCOME))
    for _ in range(n):
        try:
            read_answer(random.choice(BENDS)(random, true))
        except Exception as error:  # noqa: BLE001 - it is what is looked for
            if not isinstance(error, EpisodeError):
                yield f"{type(error).__name__}: {error}"


def main(
    messages: Annotated[int, typer.Option(min=1, help="Bent answers to the engine.")] = MESSAGES,
    seed: Annotated[int, typer.Option(min=0, help="Of what is said.")] = SEED,
) -> None:
    """Answer it all; exit code 1 if anything escaped."""
    escapes, answered = at_the_engine(messages, seed)
    served = "served" if answered else "NOT SERVED"
    print(f"{messages} bent answers, {len(escapes)} escapes, {served} afterwards")
    for escape in sorted(set(escapes))[:10]:
        print(f"    {escape}")
    raise typer.Exit(bool(escapes) or not answered)


if __name__ == "__main__":
    typer.run(main)
