"""Planners that break every rule, as plug-ins that a stranger might install."""

import contextlib
import os
import time

import msgspec

from eigenfail.values import Control


class Planner:
    class Settings(msgspec.Struct, frozen=True):
        pass

    def __init__(self, settings):
        pass

    def reset(self, mission):
        pass


class Hangs(Planner):
    def act(self, perception):
        while True:
            time.sleep(0.01)


class Dies(Planner):
    def act(self, perception):
        os._exit(7)


class Scribbles(Planner):
    """Writes what is no message into every pipe and file that its process has open."""

    def act(self, perception):
        for descriptor in range(3, 64):
            with contextlib.suppress(OSError):
                os.write(descriptor, b"\xff" * 64)
        time.sleep(60)


class Raises(Planner):
    def act(self, perception):
        raise ZeroDivisionError("a stranger's bug")


class ReturnsNone(Planner):
    def act(self, perception):
        return None


class ReturnsNaN(Planner):
    def act(self, perception):
        return Control(float("nan"), 0.0)
