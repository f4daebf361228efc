"""A method that learns a little, and goes astray at one round, as often as it is told to."""

import ctypes
import os
import subprocess
from math import nan, tanh
from pathlib import Path

import msgspec
import numpy as np

from eigenfail.errors import LearnerDiverged, ProtocolError
from eigenfail.values.episode import PolicySource, TrajectorySource
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Layer, Policy, Proposal

UNMEASURED_M = 3.0


def diverge():
    raise LearnerDiverged("The toy diverged.", "Lower its learning_rate.")


def sleep_for_ever():
    """What it started is there as long as nobody ends it."""
    subprocess.run(["sleep", "100000"], check=True)


def hold_the_interpreter():
    """No other thread of the process gets to run: that of a heartbeat would be silent as well."""
    ctypes.PyDLL(None).sleep(100_000)


def die():
    os._exit(7)


def eat_memory():
    hoard = []
    while True:
        hoard.append(b"x" * 10_000_000)


ASTRAY = {
    "diverge": diverge,
    "sleep": sleep_for_ever,
    "hold": hold_the_interpreter,
    "die": die,
    "eat": eat_memory,
}


class Known(msgspec.Struct):
    proposed: int = 0
    rounds: int = 0
    total_m: float = 0.0


class Straying:
    """Asks for noise that depends on all that it has seen.

    `fault` is what it does when it learns from round `at`, unless it did so `times` times: each is
    a line in the file `marks`. Or it is what it then proposes: `policy`, `noise`, `estimate`.
    """

    class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
        round_size: int = 4
        fault: str = ""
        at: int = 2
        times: int = 1
        marks: str = ""

    lookahead = 0

    def __init__(self, context, settings):
        self._horizon = context.horizon
        self._settings = settings
        self._known = Known()
        self._number = 0.0

    def propose(self, n):
        known = self._known
        count = min(n, self._settings.round_size)
        known.proposed += count
        if self._fault("policy"):
            layer = Layer(np.full((2, 13), nan, np.float32), np.zeros(2, np.float32))
            return Proposal((PolicySource(0),) * count, Policy(0, (), layer, layer, 1.0, 1))
        value = nan if self._fault("noise") else tanh(known.total_m + known.rounds)
        z = np.full((self._horizon, 2), value, np.float32)
        return Proposal((TrajectorySource(z),) * count)

    def observe(self, results):
        self._known.rounds += 1
        for result in results:
            measures = result.measures
            self._known.total_m += measures.robustness_m if measures else UNMEASURED_M
        for name, go_astray in ASTRAY.items():
            if self._fault(name):
                go_astray()

    def estimate(self):
        probability = nan if self._fault("estimate") else 0.5
        return Estimate(by="a toy", episodes=self._known.proposed, probability=probability)

    def state(self):
        return msgspec.json.encode(self._known)

    def restore(self, state):
        try:
            self._known = msgspec.json.decode(state, type=Known)
        except msgspec.DecodeError as error:
            raise ProtocolError(str(error)) from error

    def _fault(self, name):
        settings = self._settings
        if (settings.fault, settings.at) != (name, self._known.rounds):
            return False
        marks = Path(settings.marks)
        before = marks.read_text() if marks.exists() else ""
        if before.count("\n") >= settings.times:
            return False
        marks.write_text(before + "x\n")
        return True
