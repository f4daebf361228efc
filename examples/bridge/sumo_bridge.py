"""A bridge to SUMO, with its car-following models as planners. docs/bridge_examples.md

    python sumo_bridge.py tcp://127.0.0.1:9000

SUMO has one world in a process, so that each slot is a process of its own.
"""

import os
import subprocess
import sys
import weakref
from typing import Any

import names
import sumo_world
from minimal import PROTOCOL, Bridge, serve
from msgspec.json import decode, encode

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import Observation

WELCOME = {
    "type": "welcome",
    "protocol": PROTOCOL,
    "name": "SUMO",
    "version": "1",
    "slots": 2,
    "scenarios": [
        {
            "name": "braking_lead",
            "dt_s": sumo_world.DT_S,
            "steps": sumo_world.STEPS,
            "parameters": sumo_world.PARAMETERS,
        }
    ],
    "planners": [{"name": model, "settings": sumo_world.SETTINGS} for model in sumo_world.MODELS],
    "channels": ["longitudinal", "lateral"],
}

IDLE: list[subprocess.Popen[bytes]] = []
"""Processes whose world nobody needs any more."""


class WorldApart:
    """A world in a process of its own (contract `Simulation`).

    Args:
        asked: of a reset, what is to begin.

    Raises:
        UnknownName: it names what there is not.
    """

    dt_s = sumo_world.DT_S

    def __init__(self, asked: dict[str, Any]) -> None:
        self.steps = asked["steps"]
        given, self._channels = names.check(WELCOME, asked), names.check_channels(WELCOME, asked)
        self._process = IDLE.pop() if IDLE else started()
        self._leave = weakref.finalize(self, IDLE.append, self._process)
        self._say({"model": asked["planner"], "given": given, "steps": self.steps})

    def reset(self, seed: int) -> Observation:
        """Begin an episode."""
        return self._ask(seed)

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        """Disturb and step."""
        if self._over:
            raise SimulatorError("There is no episode to go on with.", "Reset it first.")
        errors = dict(zip(self._channels, disturbance, strict=True))
        return self._ask((errors.get("longitudinal", 0.0), errors.get("lateral", 0.0)))

    def _ask(self, question: int | tuple[float, float]) -> Observation:
        self._say(question)
        answer = self._process.stdout.readline()
        if not answer:
            raise self._ended()
        seen = decode(answer, type=Observation)
        self._over = seen.ended
        return seen

    def _say(self, words: Any) -> None:
        try:
            self._process.stdin.write(encode(words) + b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None

    def _ended(self) -> SimulatorError:
        self._leave.detach()
        return SimulatorError("SUMO has ended.", "Its last words are on standard error.")


def started() -> subprocess.Popen[bytes]:
    """A process for one world after the other; it ends with its questions."""
    return subprocess.Popen(
        [sys.executable, sumo_world.__file__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # Its remarks on other packages would be taken for an answer.
        env=os.environ | {"LIBSUMO_AS_TRACI": "quiet"},
    )


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(WELCOME, WorldApart))
