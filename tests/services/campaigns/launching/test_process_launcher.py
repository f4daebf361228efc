"""Workers as processes: started, restarted, sent home and ended; real ones but for the hub."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from tests.support.deadlines import PROCESS_S

from eigenfail.errors import ClusterUnavailable
from eigenfail.hosting.service import Span
from eigenfail.wire.keys import WorkerKey
from eigenfail_services.campaigns import process_launcher
from eigenfail_services.campaigns.process_launcher import MOST_REFUSALS, ProcessLauncher
from eigenfail_services.hub.metrics import Work, WorkerDemand

HUB = "tcp://127.0.0.1:1"

STAND_IN = """
import os, sys, time
from pathlib import Path
folder = Path(os.environ["STAND_IN_FOLDER"])
name = sys.argv[sys.argv.index("--name") + 1]
with (folder / name).open("a") as file:
    file.write(" ".join(sys.argv[1:]) + "|" + sys.stdin.read() + "\\n")
status = os.environ.get("STAND_IN_STATUS")
if status:
    sys.exit(int(status))
time.sleep(600)
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch) -> Path:
    """A module that notes how it was started in place of a worker; returns where."""
    (tmp_path / "stand_in_worker.py").write_text(STAND_IN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("STAND_IN_FOLDER", str(tmp_path))
    monkeypatch.setattr(process_launcher, "MODULE", "stand_in_worker")
    monkeypatch.setattr(process_launcher, "GOODBYE_S", 0.2)
    return tmp_path


@pytest.fixture
def launchers() -> Iterator[Callable[..., ProcessLauncher]]:
    made: list[ProcessLauncher] = []

    def make(*given) -> ProcessLauncher:
        made.append(ProcessLauncher(*given))
        return made[-1]

    yield make
    for one in made:
        one.stop()


def wait_for(condition: Callable[[], object]) -> None:
    until_s = time.monotonic() + PROCESS_S
    while not condition():
        assert time.monotonic() < until_s, "it did not happen"
        time.sleep(0.01)


OTHERS: set[psutil.Process] = set()
"""Child processes from before the test, such as services that other tests share."""


@pytest.fixture(autouse=True)
def note_others() -> None:
    OTHERS.clear()
    OTHERS.update(psutil.Process().children())


def children() -> list[psutil.Process]:
    """Child processes of the test that live."""
    mine = [one for one in psutil.Process().children() if one not in OTHERS]
    return [one for one in mine if one.status() != psutil.STATUS_ZOMBIE]


def list_lives(folder: Path) -> dict[str, list[str]]:
    """How each worker was started, by its name, once the whole line is written."""
    files = [path for path in folder.iterdir() if path.is_file() and path.suffix != ".py"]
    notes = {path.name: path.read_text() for path in files}
    return {n: text.splitlines() for n, text in notes.items() if text.endswith("\n")}


def test_each_worker_has_a_process_that_gets_the_key_but_not_in_its_arguments(
    stand_in, launchers
) -> None:
    launcher, key = launchers(Span(2, 2)), WorkerKey(b"h" * 32, b"s" * 32)
    launcher.start(HUB, key)
    wait_for(lambda: len(list_lives(stand_in)) == 2)
    for name, (line,) in list_lives(stand_in).items():
        words, given = line.split("|")
        assert words == f"--connect {HUB} --name {name} --key-file /dev/stdin"
        assert given == key.text()
    assert key.text() not in " ".join(word for one in children() for word in one.cmdline())
    launcher.stop()
    assert children() == []


def test_a_killed_worker_is_started_again_after_ever_longer_pauses(
    stand_in, launchers, clock, table
) -> None:
    launcher = launchers(Span(1, 1), clock)
    launcher.start(HUB)
    pauses = []
    for life in range(1, 8):
        wait_for(lambda n=life: [len(one) for one in list_lives(stand_in).values()] == [n])
        (process,) = children()
        process.kill()
        wait_for(lambda: not children())
        launcher.poll(table)  # sees the end, and sets the time of the next start
        killed_s = clock.now_s
        while not children():
            clock.now_s += 0.5
            assert not launcher.poll(table)
        pauses.append(clock.now_s - killed_s)
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]


def test_a_worker_that_is_refused_again_and_again_gives_up_and_is_told_of(
    stand_in, launchers, clock, table, monkeypatch
) -> None:
    monkeypatch.setenv("STAND_IN_STATUS", "2")
    launcher = launchers(Span(1, 1), clock)
    launcher.start(HUB)
    notices = []
    until_s = time.monotonic() + PROCESS_S
    while not notices and time.monotonic() < until_s:
        # A worker that lives for long is no refused one: time stands still until it has ended.
        if not children():
            clock.now_s += 1.0
        notices += launcher.poll(table)
        time.sleep(0.01)
    assert [one.kind for one in notices] == ["workers.refused"]
    assert f"gave up after {MOST_REFUSALS} tries" in notices[0].message
    clock.now_s += 1000.0
    assert not launcher.poll(table)
    (lives,) = list_lives(stand_in).values()
    assert len(lives) == MOST_REFUSALS


def test_refusals_count_only_in_a_row_and_once(
    stand_in, launchers, clock, table, monkeypatch
) -> None:
    monkeypatch.setenv("STAND_IN_STATUS", "2")
    launcher = launchers(Span(1, 1), clock)
    launcher.start(HUB)

    def count_lives() -> int:
        return sum(map(len, list_lives(stand_in).values()))

    for life in range(1, 2 * MOST_REFUSALS):
        wait_for(lambda n=life: count_lives() == n and not children())
        monkeypatch.setenv("STAND_IN_STATUS", "2" if (life + 1) % MOST_REFUSALS else "1")
        for _ in range(100):
            clock.now_s += 0.5
            assert not launcher.poll(table)
            if children() or count_lives() > life:
                break


def test_an_unwanted_worker_that_never_connects_is_ended(stand_in, launchers, clock, table) -> None:
    launcher = launchers(Span(0, 1, 5.0), clock)
    launcher.start(HUB)
    table.demand = WorkerDemand(Work(10, 10.0))
    clock.pass_by(3.0, launcher, table)
    wait_for(lambda: len(list_lives(stand_in)) == 1)
    table.demand = WorkerDemand()
    clock.pass_by(20.0, launcher, table)
    wait_for(lambda: not children())


def test_the_environment_of_workers_names_no_other_key_and_no_database(
    stand_in, launchers, monkeypatch
) -> None:
    given = ("EIGENFAIL_WORKER_KEY_FILE", "EIGENFAIL_DATABASE", "EIGENFAIL_HUB_KEYS")
    for name in given:
        monkeypatch.setenv(name, "/elsewhere")
    launcher = launchers(Span(1, 1))
    launcher.start(HUB)
    wait_for(lambda: list_lives(stand_in))
    (process,) = children()
    assert process.environ().keys().isdisjoint(given)
    assert "STAND_IN_FOLDER" in process.environ()


def test_workers_come_with_the_work_and_leave_when_the_hub_has_sent_them_home(
    stand_in, launchers, clock, table
) -> None:
    launcher = launchers(Span(0, 2, 10.0), clock)
    launcher.start(HUB)

    table.demand = WorkerDemand(Work(100, 100.0))
    clock.pass_by(3.0, launcher, table)
    wait_for(lambda: len(list_lives(stand_in)) == 2)
    here = frozenset(list_lives(stand_in))
    table.demand = WorkerDemand(Work(), present=here, idle=here)
    clock.pass_by(11.0, launcher, table)
    assert table.leaving == here
    assert len(children()) == 2  # the hub sends them home, no signal does
    for one in children():
        one.send_signal(signal.SIGTERM)
    wait_for(lambda: not children())
    clock.pass_by(1.0, launcher, table)
    assert table.leaving == frozenset()
    assert children() == []


def test_work_for_which_no_worker_may_be_started_is_told_once(launchers, table) -> None:
    launcher = launchers(Span(0, 0))
    launcher.start(HUB)
    assert not launcher.poll(table)
    table.demand = WorkerDemand(Work(7, 1.0))
    (notice,) = launcher.poll(table)
    assert notice.message.startswith("Episodes wait, and no worker may be started")
    assert not launcher.poll(table)


def test_no_room_for_a_process_is_an_error_at_the_start_and_waited_for_later(
    launchers, clock, table, monkeypatch
) -> None:
    def refuse(*_, **__) -> None:
        raise OSError(11, os.strerror(11))

    monkeypatch.setattr(process_launcher.subprocess, "Popen", refuse)
    launcher = launchers(Span(1, 1), clock)
    with pytest.raises(ClusterUnavailable, match=r"A worker cannot be started.*--workers"):
        launcher.start(HUB)
    (notice,) = launcher.poll(table)
    assert notice.kind == "workers.asked"
    assert "cannot be started: Resource temporarily unavailable" in notice.message
    clock.now_s += 60.0
    assert not launcher.poll(table)  # the notice is given once


def test_whoever_gives_up_before_the_start_leaves_no_process(stand_in, launchers) -> None:
    launchers(Span(2, 2)).start(HUB, given_up=lambda: True)
    assert children() == []


def test_workers_end_with_the_process_that_started_them(stand_in) -> None:
    code = (
        "import time; from eigenfail.hosting.service import Span; "
        "from eigenfail_services.campaigns import process_launcher as p; "
        "p.ProcessLauncher(Span(1, 1)).start('tcp://127.0.0.1:9'); time.sleep(600)"
    )
    parent = psutil.Popen([sys.executable, "-c", code])
    wait_for(parent.children)
    (worker,) = parent.children()
    wait_for(lambda: "--connect" in worker.cmdline())
    parent.kill()
    parent.wait()
    wait_for(lambda: not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE)
