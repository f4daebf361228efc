"""Process-wide state: what is noticed, and put back."""

import ctypes
import os
import platform
import signal
import sys
import textwrap
from pathlib import Path
from subprocess import run

import numpy as np
import pytest

from eigenfail.process_state import ProcessState, rounding_mode

PLUGINS = Path(__file__).parents[1] / "plugins"

on_x86 = pytest.mark.skipif(platform.machine() != "x86_64", reason="sets bits of x86-64")


def in_a_process(statements: str) -> str:
    """What the statements print; the plug-ins of the tests can be imported."""
    told = run(
        [sys.executable, "-c", textwrap.dedent(statements)],
        env=os.environ | {"PYTHONPATH": str(PLUGINS)},
        capture_output=True,
        check=True,
        text=True,
    )
    return told.stdout


@on_x86
def test_each_change_is_named_and_put_back() -> None:
    told = in_a_process("""
        from eigenfail.process_state import ProcessState
        from eigenfail_misbehaving import CHANGES
        state = ProcessState()
        for name, change in CHANGES.items():
            change()
            print(name, len(state.changes()), sep=":", end=" ")
            state.restore()
            assert not state.changes(), name
    """)
    counts = dict(each.rsplit(":", 1) for each in told.replace("numpy errors", "errors").split())
    assert counts.pop("nothing") == "0"
    assert set(counts.values()) == {"1"}
    assert len(counts) == 5


@on_x86
@pytest.mark.parametrize(
    ("mode", "named"), [(0, "to nearest"), (0x400, "downward"), (0x800, "upward"), (0xC00, "zero")]
)
def test_the_rounding_mode_is_found_by_arithmetic(mode, named) -> None:
    libc = ctypes.CDLL(None)
    try:
        assert libc.fesetround(mode) == 0
        found = rounding_mode()
    finally:
        libc.fesetround(0)
    assert found.endswith(named)


def test_nothing_is_no_change_and_neither_is_an_import() -> None:
    told = in_a_process("""
        from eigenfail.process_state import ProcessState
        state = ProcessState()
        import numpy.polynomial, numpy.fft, numpy.testing, scipy.optimize, pandas
        print(state.changes())
    """)
    assert told == "[]\n"


def test_a_directory_that_is_gone_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "below").mkdir()
    state = ProcessState()
    os.chdir("below")
    (tmp_path / "below").rmdir()
    assert state.changes()[0].endswith("and is removed")
    state.restore()
    assert Path.cwd() == tmp_path


def test_what_was_set_before_is_no_change() -> None:
    with np.errstate(all="raise"):
        before = signal.signal(signal.SIGUSR2, signal.SIG_IGN)
        try:
            state = ProcessState()
            assert state.changes() == []
            signal.signal(signal.SIGUSR2, before)
            assert state.changes() == ["the handler of SIGUSR2"]
        finally:
            signal.signal(signal.SIGUSR2, before)
