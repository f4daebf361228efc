"""A question answered in a process of its own, which may take its time, crash, or never end.

The module that answers is started as `python -m MODULE`; question and answer travel as bytes over
its standard input and output. What it prints goes to standard error.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from selectors import EVENT_READ, DefaultSelector
from threading import Thread

import msgspec

from eigenfail.errors import EigenfailError, ServiceError
from eigenfail.processes import ONE_THREAD, as_parent, die_with_parent, kill_group, status_within
from eigenfail.wire.http import Problem, make_error, make_problem

GENTLENESS = 5
"""How much it steps back behind what else runs on the machine."""

CHUNK_BYTES = 1 << 20
LAST_STEPS_S = 2.0
"""Between its last word and its end; threads that a planner left behind are not waited for."""

LOG = "The log of the service says more."


class Told(msgspec.Struct, frozen=True, tag=True):
    """The answer."""

    answer: bytes


class Refused(msgspec.Struct, frozen=True, tag=True):
    """Why there is none."""

    problem: Problem


def ask(module: str, question: bytes, patience_s: float) -> bytes:
    """What the module answers.

    Args:
        module: that calls `answer` when it is run.
        question: as it understands it.
        patience_s: after so long it is killed, with what it started. [s]

    Raises:
        EigenfailError: that which it raised.
        ServiceError: it took too long, or ended without an answer.
    """
    try:
        told = msgspec.msgpack.decode(
            run_question(module, question, patience_s), type=Told | Refused
        )
    except msgspec.DecodeError as error:
        raise ServiceError("The process that should answer was broken off.", LOG) from error
    if isinstance(told, Refused):
        raise make_error(told.problem)
    return told.answer


def run_question(module: str, question: bytes, patience_s: float) -> bytes:
    """What a process of the module writes; see `ask`."""
    told, write = os.pipe()
    asked = subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=told,
        stdout=subprocess.PIPE,
        env=os.environ | ONE_THREAD | as_parent(),
        process_group=0,
    )
    os.close(told)
    Thread(target=tell, args=(write, question), daemon=True).start()
    with asked:
        try:
            written = read_answer(asked, patience_s)
            status = status_within(asked, LAST_STEPS_S)
        finally:
            # Before it is waited for: then what it left behind could no longer be told.
            kill_group(asked)
    if not written:
        raise ServiceError(f"The process that should answer ended with code {status}.", LOG)
    return written


def tell(descriptor: int, question: bytes) -> None:
    """Write the question, as long as there is somebody to read it."""
    with suppress(BrokenPipeError), os.fdopen(descriptor, "wb") as pipe:
        pipe.write(question)


def read_answer(asked: "subprocess.Popen[bytes]", patience_s: float) -> bytes:
    """All that it writes.

    Raises:
        ServiceError: it did not come to its end in time.
    """
    if asked.stdout is None:
        raise RuntimeError("a pipe was asked for")
    until_s, words = time.monotonic() + patience_s, bytearray()
    with DefaultSelector() as selector:
        selector.register(asked.stdout, EVENT_READ)
        while selector.select(max(0.0, until_s - time.monotonic())):
            word = os.read(asked.stdout.fileno(), CHUNK_BYTES)
            if not word:
                return bytes(words)
            words += word
    raise ServiceError(
        f"There was no answer within {patience_s:g} s.", "Try again when the machine is idle."
    )


def answer(reply: Callable[[bytes], bytes]) -> None:
    """Answer the question of whoever started this process; errors of eigenfail are told, too."""
    die_with_parent()
    with suppress(OSError):
        os.nice(GENTLENESS)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    told: Told | Refused
    try:
        told = Told(reply(sys.stdin.buffer.read()))
    except EigenfailError as error:
        told = Refused(make_problem(error))
    with answers:
        answers.write(msgspec.msgpack.encode(told))
