"""Output of simulator and planner: how much of it the worker passes on."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import deadlines
import pytest

from eigenfail_workers.worker import resources
from eigenfail_workers.worker.resources import OutputLimiter

LIMIT_KIB = 1.0
KIB = 1024


@pytest.fixture
def pump() -> Iterator[tuple[OutputLimiter, Callable[[bytes], None], Callable[[], None]]]:
    """A pump that reads, a way to print, and one to end the printing and wait for the pump."""
    reader, writer = os.pipe()
    pump = OutputLimiter(os.fdopen(reader, "rb"), LIMIT_KIB)
    pump.start()
    with ExitStack() as closing:
        closing.callback(os.close, writer)

        def write(data: bytes) -> None:
            while data:
                data = data[os.write(writer, data) :]

        def finish() -> None:
            closing.close()
            pump.join(deadlines.PROCESS_S)

        yield pump, write, finish
        finish()


def wait_for(capfd: pytest.CaptureFixture[str], words: str) -> str:
    """What has been passed on and logged when these words are among it."""
    said, until_s = "", time.monotonic() + deadlines.PROCESS_S
    while words not in said:
        assert time.monotonic() < until_s, said
        said += "".join(capfd.readouterr())
        time.sleep(0.01)
    return said


def test_the_limit_starts_again_with_each_episode(pump, capfd) -> None:
    pumping, write, finish = pump
    for number in range(3):
        pumping.start_episode()
        write(f"episode {number}\n".encode() + b"x" * (2 * KIB))
        said = wait_for(capfd, "output suppressed")
        assert f"episode {number}\n" in said
        assert said.count("x" * 64) <= KIB / 64
    write(b"y" * 100 * KIB)
    finish()
    assert "yyy" not in "".join(capfd.readouterr())


def test_what_is_within_the_limit_is_passed_on_as_it_is(pump, capfd) -> None:
    _pumping, write, finish = pump
    write(b"\xff without a new line at the end")
    finish()
    assert capfd.readouterr().err.endswith(" without a new line at the end")


@pytest.mark.fault("disk of a log full")
def test_output_that_cannot_be_written_blocks_no_planner(pump, monkeypatch) -> None:
    _pumping, write, finish = pump
    with Path("/dev/full").open("wb") as full:
        monkeypatch.setattr(resources, "STANDARD_ERROR", full.fileno())
        write(b"x" * 1_000 * KIB)  # more than a pipe holds: it is read all the same
        finish()
