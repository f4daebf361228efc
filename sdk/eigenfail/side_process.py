"""A question answered in a process of its own, which may take its time, crash, or never end.

The module that answers is started as `python -m MODULE`; question and answer travel as bytes over
its standard input and output. What it prints goes to standard error.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

import msgspec

from eigenfail.errors import EigenfailError, ServiceError
from eigenfail.processes import ONE_THREAD, as_parent, die_with_parent, kill_group
from eigenfail.wire.problems import Problem, error_of, problem_of

GENTLENESS = 5
"""How much it steps back behind what else runs on the machine."""


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
    told = msgspec.msgpack.decode(answered(module, question, patience_s), type=Told | Refused)
    if isinstance(told, Refused):
        raise error_of(told.problem)
    return told.answer


def answered(module: str, question: bytes, patience_s: float) -> bytes:
    """What a process of the module writes; see `ask`."""
    asked = subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | ONE_THREAD | as_parent(),
        process_group=0,
    )
    with asked:
        try:
            written, _ = asked.communicate(question, patience_s)
        except subprocess.TimeoutExpired:
            raise ServiceError(
                f"There was no answer within {patience_s:g} s.",
                "Try again when the machine is idle.",
            ) from None
        finally:
            kill_group(asked)
    if asked.returncode or not written:
        raise ServiceError(
            f"The process that should answer ended with code {asked.returncode}.",
            "The log of the service says more.",
        )
    return written


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
        told = Refused(problem_of(error))
    with answers:
        answers.write(msgspec.msgpack.encode(told))
