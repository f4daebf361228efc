"""A service on a data folder: ready or refused, and in the end nothing is left of it."""

import os
import signal
import socket
import subprocess
import sys
import time

import deadlines
import psutil
import pytest

from eigenfail.errors import PortTaken, ServiceError, StoreUnavailable
from eigenfail.hosting import service as local_service
from eigenfail.hosting.folder import Address, DataFolder
from eigenfail.hosting.processes import OWNER_MARK, find_marked, interruptible
from eigenfail.hosting.service import Launcher, Plan, choose_ports, find_ready_line

STUBBORN = "while True: time.sleep(600)\n"

pytestmark = pytest.mark.service


@pytest.fixture
def plan(tmp_path):
    return Plan(tmp_path / "data", 0)


def owner(plan):
    return str(plan.data.resolve())


def start_and_stop(plan):
    with local_service.local_service(plan):
        pass


def claim_and_leave(folder):
    with folder.claimed():
        pass


def start_and_wait(plan, act):
    with interruptible(), local_service.local_service(plan):
        act()
        time.sleep(30)


def test_it_is_ready_says_where_and_leaves_nothing(stand_ins, plan):
    with local_service.local_service(plan) as service:
        assert service.address.url.startswith("http://127.0.0.1:")
        assert service.address.hub.startswith("tcp://127.0.0.1:")
        assert DataFolder(plan.data).address() == service.address
        service.check()
        assert len(find_marked(owner(plan))) == 3
    assert find_marked(owner(plan)) == []
    assert DataFolder(plan.data).address() is None


def test_a_second_one_on_the_same_folder_is_refused_with_the_address(stand_ins, plan):
    with local_service.local_service(plan) as service:
        with pytest.raises(ServiceError, match=f"runs on .* already, at {service.address.url}"):
            start_and_stop(plan)
        service.check()


@pytest.mark.fault(
    "part of a service that cannot start, or dies",
    group="processes",
    outcome="`eigenfail up` ends the other parts, names the part with its last lines, and "
    "exits with 3.",
)
@pytest.mark.parametrize("part", ["controller", "services"])
def test_a_part_that_refuses_to_start_is_named_with_its_reason(stand_ins, plan, part):
    stand_ins[part] = "print('a log line'); raise SystemExit(print('eigenfail: No.') or 3)"
    with pytest.raises(ServiceError) as caught:
        start_and_stop(plan)
    assert str(caught.value) == (
        f"The {part} process ended by itself (exit code 3): No. "
        f"The whole log is in {plan.data / part}.log."
    )
    assert find_marked(owner(plan)) == []


@pytest.mark.fault("part of a service that cannot start, or dies")
def test_a_part_that_breaks_is_named_with_its_last_lines(stand_ins, plan):
    stand_ins["services"] = "print('a log line', flush=True); 1 / 0"
    with pytest.raises(ServiceError) as caught:
        start_and_stop(plan)
    assert "The services process ended by itself (exit code 1): \n  a log line" in str(caught.value)
    assert "  ZeroDivisionError: division by zero\n" in str(caught.value)


def test_only_what_was_said_this_time_is_repeated(stand_ins, plan):
    plan.data.mkdir()
    (plan.data / "services.log").write_text('{"ready": true, "hub": "old"}\nold trouble\n')
    stand_ins["services"] = "raise SystemExit(1)"
    with pytest.raises(ServiceError) as caught:
        start_and_stop(plan)
    assert "old trouble" not in str(caught.value)


@pytest.mark.fault("part of a service that cannot start, or dies")
def test_a_part_that_dies_later_is_noticed(stand_ins, plan):
    with local_service.local_service(plan) as service:
        service.parts[1].process.kill()
        service.parts[1].process.wait()
        with pytest.raises(ServiceError, match=r"The services process ended .*exit code -9"):
            service.check()
    assert find_marked(owner(plan)) == []


@pytest.mark.fault("part of a service that cannot start, or dies")
def test_a_part_that_is_never_ready_is_given_up(stand_ins, plan, monkeypatch):
    monkeypatch.setattr(local_service, "READY_WITHIN_S", 0.5)
    stand_ins["services"] = "import time; time.sleep(600)"
    with pytest.raises(ServiceError, match=r"not ready after .*services\.log"):
        start_and_stop(plan)
    assert find_marked(owner(plan)) == []


@pytest.mark.fault("part of a service that cannot start, or dies")
def test_a_part_that_ignores_the_signal_is_killed(stand_ins, plan, monkeypatch):
    monkeypatch.setattr(local_service.processes.stop_parts, "__defaults__", (0.3,))
    stand_ins["services"] = (
        "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n" + stand_ins["services"]
    )
    with local_service.local_service(plan):
        pass
    assert find_marked(owner(plan)) == []


@pytest.mark.fault(
    "services killed together with their command line",
    group="processes",
    outcome="The next start on the same folder ends what is left of them, and no process of "
    "anybody else.",
)
def test_what_a_killed_command_line_left_is_ended_by_the_next_one(stand_ins, plan):
    left = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        env=os.environ | {OWNER_MARK: owner(plan)},
    )
    with local_service.local_service(plan):
        assert left.wait(timeout=deadlines.PROCESS_S) == -signal.SIGKILL


@pytest.mark.fault("services killed together with their command line")
def test_nobody_elses_processes_are_ended(stand_ins, plan):
    other = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        env=os.environ | {OWNER_MARK: owner(plan) + "-other"},
    )
    try:
        with local_service.local_service(plan):
            pass
        assert psutil.Process(other.pid).status() != psutil.STATUS_ZOMBIE
    finally:
        other.kill()
        other.wait()


@pytest.mark.fault("port already in use")
def test_a_taken_port_is_refused_before_anything_starts(stand_ins, plan):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PortTaken, match=f"Port {port} .*Address already in use.*--port"):
            start_and_stop(Plan(plan.data, port))
        with pytest.raises(PortTaken, match=f"Port {port} .*--hub-port"):
            start_and_stop(Plan(plan.data, 0, hub_port=port))
    assert not plan.data.exists()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreUnavailable, match=r"cannot be written: .*--data"):
        claim_and_leave(DataFolder(tmp_path / "file" / "data"))
    assert not DataFolder(tmp_path / "file" / "data").is_writable()
    assert DataFolder(tmp_path / "not" / "yet").is_writable()


def test_a_stale_address_is_not_believed(tmp_path):
    folder = DataFolder(tmp_path)
    with folder.claimed():
        folder.publish(Address("http://127.0.0.1:1", "tcp://127.0.0.1:2"))
        written = folder.address_file.read_bytes()
    folder.address_file.write_bytes(written)
    assert folder.address() is None
    folder.address_file.write_text("not json")
    assert folder.address() is None


def test_ports_are_free_ones(plan):
    port, hub_port = choose_ports(plan)
    assert port > 0
    assert hub_port > 0
    assert choose_ports(Plan(plan.data, port))[0] == port


def test_the_ready_line_is_found_among_others():
    lines = ["", "starting", "[1]", '{"ready": 1}', '{"event": "x"}', '{"ready": true, "hub": "h"}']
    found = find_ready_line(lines)
    assert found is not None
    assert found.hub == "h"
    assert find_ready_line(lines[:-1]) is None


def test_the_commands_name_the_modules_and_the_addresses(plan):
    commands = local_service.make_commands(
        Plan(plan.data, 0, workers=3, launcher=Launcher.NONE), "sqlite:///x.db", 8440, 8441
    )
    assert commands["controller"][1:] == [
        *("-m", "eigenfail_api", "--database", "sqlite:///x.db"),
        *("--host", "127.0.0.1", "--port", "8440"),
    ]
    assert commands["services"][1:] == [
        *("-m", "eigenfail_services", "--database", "sqlite:///x.db"),
        *("--workers", "3", "--launcher", "none", "--hub", "tcp://127.0.0.1:8441"),
    ]


@pytest.mark.fault(
    "SIGTERM or Ctrl-C of a service, once or twice",
    group="processes",
    outcome="The service stops in order and leaves no process behind; a second signal stops "
    "it at once.",
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_every_signal_to_stop_leaves_nothing(stand_ins, plan, number):
    with pytest.raises(KeyboardInterrupt):
        start_and_wait(plan, lambda: os.kill(os.getpid(), number))
    assert find_marked(owner(plan)) == []


@pytest.mark.fault("SIGTERM or Ctrl-C of a service, once or twice")
def test_a_second_signal_ends_the_patience_and_still_leaves_nothing(stand_ins, plan):
    stand_ins["services"] = (
        "import os, signal\n"
        "signal.signal(signal.SIGTERM, lambda *_: os.kill(os.getppid(), signal.SIGINT))\n"
        "import time\n" + stand_ins["services"].replace("time.sleep(600)\n", STUBBORN)
    )
    began = time.monotonic()
    start_and_stop(plan)
    assert time.monotonic() - began < 15.0
    assert find_marked(owner(plan)) == []
