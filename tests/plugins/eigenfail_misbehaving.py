"""Planners that break every rule, as plug-ins that a stranger might install."""

import contextlib
import ctypes
import os
import platform
import signal
import sys
import time
from pathlib import Path
from threading import Event, Thread

import msgspec
import numpy as np

from eigenfail.values.scene import Control


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
        write_everywhere(b"\xff" * 64)


class Raises(Planner):
    def act(self, perception):
        raise ZeroDivisionError("a stranger's bug")


class ReturnsNone(Planner):
    def act(self, perception):
        return None


class ReturnsNaN(Planner):
    def act(self, perception):
        return Control(float("nan"), 0.0)


LEAP_M = 50.0
FILES_AN_EPISODE = 50
MEGABYTE = 1_000_000
kept = []


def leak(folder):
    while True:
        kept.append(b"x" * 4 * MEGABYTE)
        time.sleep(0.005)


def touch_nothing_at_zero(folder):
    ctypes.string_at(0)


def hang_in_c(folder):
    ctypes.PyDLL(None).sleep(3600)


def open_files(folder):
    while True:
        kept.append(os.dup(0))


def start_threads(folder):
    while True:
        Thread(target=Event().wait, daemon=True).start()
        time.sleep(0.001)


def write_everywhere(what):
    for descriptor in range(3, 64):
        with contextlib.suppress(OSError):
            os.write(descriptor, what)
    time.sleep(60)


def mumble(folder):
    """Messages of no bytes at all."""
    write_everywhere(b"\0" * 64)


def fork_on(folder):
    """Start one that outlives every test, and tell who it is."""
    pid = os.fork()
    if pid == 0:
        time.sleep(600.0)
        os._exit(0)
    (folder / str(pid)).touch()


def escape(folder, live):
    """Start one that is in nobody's group or session but its own, and nobody's child."""
    between = os.fork()
    if between:
        os.waitpid(between, 0)
        return
    os.setsid()
    if os.fork() == 0:
        os.setsid()
        (folder / str(os.getpid())).touch()
        live()
    os._exit(0)


def escape_and_die(folder):
    escape(folder, lambda: time.sleep(600.0))
    until_there_is_one(folder)
    os._exit(7)


def escape_and_hang(folder):
    escape(folder, lambda: time.sleep(600.0))
    hang_in_c(folder)


def spin():
    while True:
        pass


def leave_one_that_spins(folder):
    escape(folder, spin)
    until_there_is_one(folder)


def until_there_is_one(folder):
    while not any(folder.iterdir()):
        time.sleep(0.01)


def start_processes(folder):
    while True:
        fork_on(folder)
        time.sleep(0.01)


def fork_and_die(folder):
    fork_on(folder)
    os._exit(7)


def fork_and_hang(folder):
    fork_on(folder)
    hang_in_c(folder)


def print_much(folder):
    for _ in range(5):
        sys.stdout.write("x" * MEGABYTE)
        os.write(1, b"y" * MEGABYTE)


def read_input(folder):
    if sys.stdin.read():
        raise RuntimeError("somebody typed")


def want_too_much(folder):
    bytearray(2**60)


def interrupt(folder):
    raise KeyboardInterrupt


def leave(folder):
    sys.exit(4)


WAYS = {
    "leaks": leak,
    "segfaults": touch_nothing_at_zero,
    "hangs in C": hang_in_c,
    "opens files": open_files,
    "starts threads": start_threads,
    "starts processes": start_processes,
    "forks and dies": fork_and_die,
    "forks and hangs": fork_and_hang,
    "escapes and dies": escape_and_die,
    "escapes and hangs": escape_and_hang,
    "leaves one that spins": leave_one_that_spins,
    "prints": print_much,
    "reads": read_input,
    "wants too much": want_too_much,
    "interrupts": interrupt,
    "leaves": leave,
    "mumbles": mumble,
}


class Misbehaves(Planner):
    """In one of the ways, when the vehicle ahead seems to leap; otherwise it lets itself roll."""

    class Settings(msgspec.Struct, frozen=True):
        way: str
        folder: str = ""

    def __init__(self, settings):
        self.settings = settings

    def reset(self, mission):
        self.seen_m = None

    def act(self, perception):
        now_m = perception.others[0].x_m
        before_m, self.seen_m = self.seen_m, now_m
        if before_m is not None and abs(now_m - before_m) > LEAP_M:
            WAYS[self.settings.way](Path(self.settings.folder))
        return Control(0.0, 0.0)


class Prints(Planner):
    """Prints much in every episode, its number first."""

    class Settings(msgspec.Struct, frozen=True):
        kib: int = 1024

    def __init__(self, settings):
        self.kib = settings.kib
        self.episodes = 0

    def reset(self, mission):
        sys.stdout.write(f"episode {self.episodes} begins\n")
        self.episodes += 1
        for _ in range(self.kib):
            sys.stdout.write("x" * 1023 + "\n")
        sys.stdout.flush()

    def act(self, perception):
        return Control(0.0, 0.0)


class ForgetsFiles(Planner):
    """Opens some in every episode, and closes none; and leaves a thread that never ends."""

    def reset(self, mission):
        Thread(target=Event().wait).start()
        kept.extend(os.dup(0) for _ in range(FILES_AN_EPISODE))

    def act(self, perception):
        return Control(0.0, 0.0)


UPWARD = {"x86_64": 0x800, "aarch64": 0x400000}
FLUSH_TO_ZERO = 0x8040
MXCSR = slice(28, 32)


def round_upward():
    ctypes.CDLL(None).fesetround(UPWARD[platform.machine()])


def flush_denormals():
    """Set both bits in glibc's environment of x86-64, as code built with -ffast-math does."""
    environment = ctypes.create_string_buffer(64)
    ctypes.CDLL(None).fegetenv(environment)
    bits = int.from_bytes(environment.raw[MXCSR], "little") | FLUSH_TO_ZERO
    environment[MXCSR] = bits.to_bytes(4, "little")
    ctypes.CDLL(None).fesetenv(environment)


CHANGES = {
    "rounding": round_upward,
    "denormals": flush_denormals,
    "numpy errors": lambda: np.seterr(all="raise"),
    "directory": lambda: os.chdir("/"),
    "signals": lambda: signal.signal(signal.SIGUSR1, lambda *_: None),
    "nothing": lambda: None,
}
CALLS = []


class ChangesState(Planner):
    """Changes one thing of its process in the middle of each episode that is not left out."""

    class Settings(msgspec.Struct, frozen=True):
        what: str
        from_episode: int = 0
        fails: bool = False

    def __init__(self, settings):
        self.settings = settings

    def reset(self, mission):
        CALLS.append("reset")

    def act(self, perception):
        if len(CALLS) > self.settings.from_episode and perception.time_s > 1.0:
            CHANGES[self.settings.what]()
            if self.settings.fails:
                raise ValueError("a consequence")
        return Control(0.0, 0.0)


class UnreadableError(Exception):
    def __str__(self):
        raise RuntimeError("no text")


class EvasiveError(Exception):
    def __str__(self):
        return 7  # noqa: PLE0307 - that is what is wrong with it


ERRORS = {
    "lone surrogate": ValueError("half of a pair: \udc80"),
    "NUL": ValueError("before\x00after"),
    "megabytes": ValueError("x" * 3_000_000),
    "__str__ raises": UnreadableError(),
    "__str__ returns a number": EvasiveError(),
}


class RaisesText(Planner):
    class Settings(msgspec.Struct, frozen=True):
        text: str

    def __init__(self, settings):
        self.settings = settings

    def act(self, perception):
        raise ERRORS[self.settings.text]
