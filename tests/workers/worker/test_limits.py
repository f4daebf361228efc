"""What an inner process may take: how the limit is given, and how much is counted."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from eigenfail.bridges import EPISODE_VARIABLE
from eigenfail.errors import InvalidValue
from eigenfail_workers.bridge.connection import make_timeouts, read_timeouts
from eigenfail_workers.limits import (
    CPU,
    MEMORY,
    OUTPUT,
    Limits,
    is_out_of_files,
    read_episode_limit,
    read_limits,
)
from eigenfail_workers.worker.resources import ResourceMonitor, list_process_tree

TOLD = "\nimport sys; print(flush=True); sys.stdin.read()"
FORKS = "\nimport os\nfor _ in range(2): os.fork() or (os.read(0, 1), os._exit(0))"
SHARED = "x = b'x' * 200_000_000" + FORKS
OF_A_FILE = """
import mmap, os
file = os.open({file!r}, os.O_RDWR | os.O_CREAT)
os.ftruncate(file, 400_000_000)
x = mmap.mmap(file, 400_000_000)
x[::4096] = x[::4096]
"""


@pytest.fixture
def program() -> Iterator[Callable[[str], int]]:
    """Runs statements in a process that then waits; its pid."""
    started: list[subprocess.Popen] = []

    def run(statements: str) -> int:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        process = subprocess.Popen([sys.executable, "-c", statements + TOLD], **pipes)
        started.append(process)
        process.stdout.readline()
        return process.pid

    yield run
    for process in started:
        process.communicate()


@pytest.mark.parametrize(("written", "memory_mib"), [(None, 4096.0), ("256", 256.0), ("1e4", 1e4)])
def test_the_limit_of_memory_is_read(monkeypatch, written, memory_mib) -> None:
    monkeypatch.delenv(MEMORY.variable, raising=False)
    assert read_limits(written).memory_mib == memory_mib
    if written:
        monkeypatch.setenv(MEMORY.variable, written)
    assert read_limits().memory_mib == memory_mib
    assert read_limits("512").memory_mib == 512.0


def test_processor_time_goes_by_the_wall_time_of_an_episode(monkeypatch) -> None:
    monkeypatch.delenv(CPU.variable, raising=False)
    monkeypatch.delenv(EPISODE_VARIABLE, raising=False)
    for episode_s, written, told in (
        (None, None, (240.0, 4.0)),
        ("600", None, (2400.0, 4.0)),
        ("60", "120", (120.0, 2.0)),
        ("60", "10", (10.0, 1.0)),
    ):
        limits = read_limits(cpu_limit=written, episode_limit=episode_s)
        assert (limits.cpu_s, limits.processors) == told
    assert read_limits() == Limits()
    monkeypatch.setenv(CPU.variable, "99")
    assert read_limits().cpu_s == 99.0
    with pytest.raises(InvalidValue, match=r"--cpu-limit: '9' is no .* seconds, 10 or more.*CPU_"):
        read_limits(cpu_limit="9")


def test_the_wall_time_of_an_episode_is_that_of_the_option_or_of_the_environment(monkeypatch):
    monkeypatch.delenv(EPISODE_VARIABLE, raising=False)
    assert read_episode_limit() == 60.0
    monkeypatch.setenv(EPISODE_VARIABLE, "90")
    assert read_episode_limit() == 90.0
    assert read_episode_limit("120.5") == 120.5
    with pytest.raises(InvalidValue, match=r"--episode-limit: '0' is no .* 1 or more.*EPISODE_"):
        read_episode_limit("0")


def test_who_asks_a_bridge_reads_it_likewise(monkeypatch) -> None:
    monkeypatch.setenv(EPISODE_VARIABLE, "")
    assert read_timeouts() == make_timeouts(60.0)
    monkeypatch.setenv(EPISODE_VARIABLE, "abc")
    with pytest.raises(InvalidValue, match="'abc' is no number of seconds"):
        read_timeouts()


def test_the_limit_of_output_is_read(monkeypatch) -> None:
    monkeypatch.delenv(OUTPUT.variable, raising=False)
    assert read_limits().output_kib == 64.0
    assert read_limits(output_limit="1").output_kib == 1.0
    monkeypatch.setenv(OUTPUT.variable, "1024")
    assert read_limits().output_kib == 1024.0
    for wrong in ("0", "much", "inf"):
        with pytest.raises(InvalidValue, match=r"--output-limit: .* KiB, 1 or more.*OUTPUT_LIMIT"):
            read_limits(output_limit=wrong)


@pytest.mark.parametrize("written", ["many", "nan", "inf", "-1", "0", "255", "4 GiB"])
def test_what_is_no_limit_is_refused_with_both_names(monkeypatch, written) -> None:
    with pytest.raises(InvalidValue, match=r"--memory-limit: .* 256 or more.*MEMORY_LIMIT_MIB"):
        read_limits(written)


def test_a_wrong_limit_is_one_sentence() -> None:
    program = Path(sys.executable).with_name("eigenfail")
    command = [program, "worker", "--connect", "tcp://127.0.0.1:1", "--memory-limit", "9"]
    told = subprocess.run(command, capture_output=True, check=False)
    assert (told.returncode, told.stderr.count(b"\n")) == (2, 1)
    assert b"--memory-limit: '9.0' is no number of MiB, 256 or more." in told.stderr


@pytest.mark.fault("planner that leaks memory, threads or processes")
def test_memory_is_counted_with_that_of_descendants_but_not_twice(program) -> None:
    pid = program(SHARED)
    assert len(list_process_tree(pid)) == 3
    assert sum(process.memory_info().rss for process in list_process_tree(pid)) > 600e6
    assert ResourceMonitor(pid, Limits(memory_mib=400.0)).find_excess() == ""
    assert (
        "of memory, where 150 MiB is the limit"
        in ResourceMonitor(pid, Limits(memory_mib=150.0)).find_excess()
    )


@pytest.mark.fault("planner that leaks memory, threads or processes")
def test_pages_of_files_are_not_counted(program, tmp_path) -> None:
    found = subprocess.run(
        ["stat", "--file-system", "--format=%T", tmp_path], capture_output=True, check=True
    )
    if found.stdout.strip() in {b"tmpfs", b"ramfs"}:
        pytest.skip("files are in memory here")
    pid = program(OF_A_FILE.format(file=str(tmp_path / "map")))
    assert psutil.Process(pid).memory_info().rss > 200e6
    assert ResourceMonitor(pid, Limits(memory_mib=150.0)).find_excess() == ""


@pytest.mark.fault("planner that leaks memory, threads or processes")
def test_threads_are_counted_with_processes(program) -> None:
    wait = "import threading; threading.Thread(target=threading.Event().wait, daemon=True).start()"
    pid = program(FORKS + "\n" + wait)
    assert ResourceMonitor(pid, Limits(threads=4)).find_excess() == ""
    assert (
        ResourceMonitor(pid, Limits(threads=3))
        .find_excess()
        .startswith("ran 4 threads and processes")
    )


def test_nobody_is_watched_any_more() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert ResourceMonitor(ended.pid, Limits(threads=0)).find_excess() == ""


@pytest.mark.fault("planner that leaks open files, or allocates more memory than there is")
def test_files_are_used_up_before_the_last_is_open() -> None:
    assert not is_out_of_files()
    kept = "import resource, os\nresource.setrlimit(resource.RLIMIT_NOFILE, (100, 100))\n"
    kept += "from eigenfail_workers.limits import is_out_of_files\n"
    tried = "told = [is_out_of_files() or os.dup(0) for _ in range(99)]; print(told.index(True))"
    told = subprocess.run(
        [sys.executable, "-c", kept + tried], capture_output=True, check=True, stdin=subprocess.PIPE
    )
    assert 20 < int(told.stdout) < 40


WITHOUT_FILES = """
import psutil, resource
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker import resources

process = psutil.Process()
monitor = resources.ResourceMonitor(process.pid, Limits())
resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
measured = [
    resources.resident_mib(process),
    resources.processor_time_s([process]),
    len(resources.list_process_tree(process.pid)),
]
print(measured, repr(monitor.find_excess()))
"""


@pytest.mark.fault(
    "worker without a free file descriptor",
    group="processes",
    outcome="Limits are not checked until a file can be opened again; the worker goes on.",
)
def test_a_worker_that_cannot_open_a_file_measures_nothing_and_goes_on() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_FILES], capture_output=True, text=True, check=False
    )
    assert (done.stdout.split(), done.stderr) == (["[0.0,", "0.0,", "0]", "''"], "")
