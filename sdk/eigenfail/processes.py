"""Subprocesses that end with their parent and leave no processes behind."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from ctypes import CDLL
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from subprocess import Popen, TimeoutExpired
from threading import Thread
from typing import NoReturn

import msgspec

from eigenfail.errors import EigenfailError, ServiceError
from eigenfail.wire.http import Problem, make_error, make_problem

# Numbers of <linux/prctl.h>, which Python does not have.
PR_SET_PDEATHSIG = 1


PR_SET_CHILD_SUBREAPER = 36


PARENT_VARIABLE = "EIGENFAIL_PARENT"


END_S = 2.0
"""Maximum wait for a killed process, which takes a while to return much memory [s]."""


LOOK_EVERY_S = 0.005


ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process that shares its machine with others of its kind."""


COMMON_KERNELS = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "MKL_CBWR": "COMPATIBLE",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "ATEN_CPU_CAPABILITY": "avx2",
}
"""Environment in which OpenBLAS, numpy, MKL, oneDNN and torch compute alike on all processors of
`COMMON_PROCESSOR`. Left to themselves each takes the kernels of the processor's type, whose sums
differ in their last bits."""


COMMON_PROCESSOR = "x86-64 with AVX2 and FMA"


def find_processor(facts: Path = Path("/proc/cpuinfo")) -> str:
    """Return the kind of this processor, which decides how libraries sum; empty if unknown.

    It is `COMMON_PROCESSOR` for processors with AVX2 and FMA, otherwise the name of the model.
    """
    with suppress(OSError):
        told = facts.read_text()
        flags = re.search(r"^flags\s*:(.*)$", told, re.MULTILINE)
        if flags and {"avx2", "fma"} <= set(flags[1].split()):
            return COMMON_PROCESSOR
        model = re.search(r"^model name\s*:\s*(.+)$", told, re.MULTILINE)
        return model[1] if model else ""
    return ""


NUMERIC_ENVIRONMENT = ONE_THREAD | (COMMON_KERNELS if find_processor() == COMMON_PROCESSOR else {})
"""Environment of a process whose numbers are to be those of any other machine: learners, analyses,
and workers' inner processes. Libraries read it when they are loaded."""


def as_parent() -> dict[str, str]:
    """Return the variable that makes a child process end with this one; see `die_with_parent`."""
    return {PARENT_VARIABLE: str(os.getpid())}


def die_with_parent(by: signal.Signals = signal.SIGKILL) -> None:
    """Have the kernel signal this process when its parent dies, even while it is busy (Linux).

    By default the signal kills the process.
    """
    if sys.platform == "linux":
        CDLL(None).prctl(PR_SET_PDEATHSIG, by)
    # Taken out, so that grandchildren do not compare their own parent with this number.
    parent = os.environ.pop(PARENT_VARIABLE, None)
    if parent is not None and os.getppid() != int(parent):  # it died before the kernel was asked
        # The status that a shell reports of a process that was killed.
        os._exit(128 + signal.SIGKILL)


def adopt_orphans() -> None:
    """Become the parent of descendants that lose their parent (Linux).

    Such a process can then be found and ended even if it left its group or session.
    """
    if sys.platform == "linux":
        CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def exit_status(process: Popen[bytes]) -> int | None:
    """Return the exit status of a process: None while it lives, negative if a signal ended it.

    The process is not waited for. So its number is not reused, and `kill_group` can use the number
    to find processes that it left behind.
    """
    if process.returncode is None:
        with suppress(ChildProcessError):  # another thread has waited for it
            status = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if status is None:
                return None
            return status.si_status if status.si_code == os.CLD_EXITED else -status.si_status
    return process.poll()


def wait_for_exit(process: Popen[bytes], patience_s: float) -> int | None:
    """Wait for a process and return its `exit_status`; None if it outlives the time limit."""
    until_s = time.monotonic() + patience_s
    while (status := exit_status(process)) is None and time.monotonic() < until_s:
        time.sleep(LOOK_EVERY_S)
    return status


def kill_group(leader: Popen[bytes]) -> None:
    """Kill a process that leads a group, and the rest of its group.

    If the process was waited for, do nothing: its number may now belong to other processes.
    """
    if leader.returncode is None:
        with suppress(ProcessLookupError):
            os.killpg(leader.pid, signal.SIGKILL)
        # It may take longer to return its memory: it ends all the same, without us.
        with suppress(TimeoutExpired):
            leader.wait(END_S)


def end_now(status: int) -> NoReturn:
    """Exit without waiting for threads, after flushing standard output and error."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


GENTLENESS = 5
"""How much it steps back behind what else runs on the machine."""


CHUNK_BYTES = 1 << 20


LAST_STEPS_S = 2.0
"""Between its last word and its end; threads that a planner left behind are not waited for."""


LOG = "See the log of the service."


class Answered(msgspec.Struct, frozen=True, tag=True):
    """The answer."""

    answer: bytes


class Refused(msgspec.Struct, frozen=True, tag=True):
    """The reason for a missing answer."""

    problem: Problem


def ask(module: str, question: bytes, patience_s: float) -> bytes:
    """Start a process that runs a module, send it a question, and return its answer.

    Args:
        module: module that calls `answer` when it is run.
        question: question in the module's encoding.
        patience_s: time limit, after which the process and its children are killed. [s]

    Raises:
        EigenfailError: the module raised this error.
        ServiceError: the process took too long, or ended without an answer.
    """
    try:
        # A process that is killed while it writes leaves the beginning of an answer.
        received = msgspec.msgpack.decode(
            run_question(module, question, patience_s), type=Answered | Refused
        )
    except msgspec.DecodeError as error:
        raise ServiceError("The subprocess was terminated.", LOG) from error
    if isinstance(received, Refused):
        raise make_error(received.problem)
    return received.answer


def run_question(module: str, question: bytes, patience_s: float) -> bytes:
    """Return the output of a process of the module; see `ask`."""
    read, write = os.pipe()
    asked = subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=read,
        stdout=subprocess.PIPE,
        env=os.environ | NUMERIC_ENVIRONMENT | as_parent(),
        process_group=0,
    )
    # The process alone holds this end now, so that writing fails once it has died.
    os.close(read)
    # A pipe holds 64 KiB: without a thread, a process that does not read would hold this one
    # up, and `patience_s` would not count.
    Thread(target=write_question, args=(write, question), daemon=True).start()
    with asked:
        try:
            written = read_answer(asked, patience_s)
            status = wait_for_exit(asked, LAST_STEPS_S)
        finally:
            # Before it is waited for: afterwards its children could no longer be found.
            kill_group(asked)
    if not written:
        raise ServiceError(f"The subprocess exited with code {status}.", LOG)
    return written


def write_question(descriptor: int, question: bytes) -> None:
    """Write the question while the process reads."""
    with suppress(BrokenPipeError), os.fdopen(descriptor, "wb") as pipe:
        pipe.write(question)


def read_answer(asked: "subprocess.Popen[bytes]", patience_s: float) -> bytes:
    """Return all output of the process.

    Raises:
        ServiceError: it did not end in time.
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
    """Answer the question on standard input; errors of eigenfail become part of the answer."""
    die_with_parent()
    with suppress(OSError):
        os.nice(GENTLENESS)
    # What plug-ins print must not get into the answer: it goes to standard error.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    reply_sent: Answered | Refused
    try:
        reply_sent = Answered(reply(sys.stdin.buffer.read()))
    except EigenfailError as error:
        reply_sent = Refused(make_problem(error))
    with answers:
        answers.write(msgspec.msgpack.encode(reply_sent))
