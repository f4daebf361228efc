"""Workers that Ray places: found, killed, replaced, and gone when the service ends."""

import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import deadlines
import psutil
import pytest
import reader
from killed_worker import check_gone, check_replacement, find_digest, list_descendants

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, Span
from eigenfail_services.hub.keys import KeyFolder

pytestmark = pytest.mark.service

FIELDS = {"name": "ray", "method": "monte_carlo", "planner": "idm", "episodes": 400, "seed": 8}
SHORT = FIELDS | {"episodes": 160}


def actors(service) -> list[psutil.Process]:
    """The processes in which Ray runs the workers of this service."""
    services = next(part for part in service.parts if part.name == "services")
    below = psutil.Process(services.process.pid).children(recursive=True)
    return [process for process in below if process.name().startswith("ray::WorkerAct")]


def doors(service) -> set[str]:
    """The addresses at which the services listen, and all that they started."""
    services = psutil.Process(service.parts[1].process.pid)
    family = [services, *services.children(recursive=True)]
    sockets = [each for process in family for each in process.net_connections("inet")]
    return {each.laddr.ip for each in sockets if each.status == psutil.CONN_LISTEN}


@pytest.mark.fault(
    "SIGKILL of a Ray worker",
    group="processes",
    outcome="Ray starts it again, and its episodes go to others meanwhile. The campaign keeps"
    " its digest.",
)
def test_a_killed_ray_worker_is_replaced_and_changes_nothing(fresh_service, tmp_path) -> None:
    """On a hub that asks for keys, which they get from the service without anybody's doing."""
    KeyFolder(tmp_path / "data" / "hub-keys").create("by-hand", tmp_path / "by-hand.key")
    with fresh_service(Launcher.RAY, workers=2) as service:
        check_replacement(service, FIELDS, actors)
        assert doors(service) <= {"127.0.0.1", "::ffff:127.0.0.1", "::1"}
        everything = list_descendants(service)
    check_gone(everything)


@pytest.fixture
def ray_folder(monkeypatch) -> Iterator[Path]:
    """Where Ray keeps its files; the path is short, as paths of sockets must be."""
    with tempfile.TemporaryDirectory(prefix="r-", dir="/tmp") as folder:
        monkeypatch.setenv("RAY_TMPDIR", folder)
        yield Path(folder)


PRINTING = {"name": "p", "method": "monte_carlo", "simulator": "point_mass", "episodes": 16}
PRINTING |= {"planner": "test_prints", "planner_settings": {"kib": 1024}}


@pytest.mark.fault("planner that prints without end")
@pytest.mark.parametrize(
    ("bounds", "most_bytes"),
    [
        ({"EIGENFAIL_OUTPUT_LIMIT_KIB": "2"}, 500_000),
        ({"EIGENFAIL_OUTPUT_LIMIT_KIB": "1e6", "RAY_ROTATION_MAX_BYTES": "1000000"}, 3_000_000),
    ],
    ids=["the worker's own", "Ray's"],
)
def test_what_a_planner_prints_has_bounds_under_ray_and_goes_with_the_service(
    fresh_service, ray_folder, monkeypatch, bounds, most_bytes
) -> None:
    """16 MiB are printed."""
    for name, value in bounds.items():
        monkeypatch.setenv(name, value)
    with fresh_service(Launcher.RAY) as service, Client(service.address.url) as client:
        campaign = client.campaigns.create(**PRINTING).id
        assert (
            client.campaigns.wait(campaign, timeout_s=deadlines.CAMPAIGN_S).counts.completed == 16
        )
        logs = [*ray_folder.glob("ray-*/session_2*/logs/worker-*")]
        assert any(b"episode " in log.read_bytes() for log in logs)
        assert sum(log.stat().st_size for log in logs) < most_bytes
        assert "xxx" not in service.parts[1].log.read_text()
    assert [*ray_folder.iterdir()] == []


def driver(service) -> psutil.Process:
    """The process of Ray's driver."""
    services = psutil.Process(service.parts[1].process.pid)
    return next(
        below for below in services.children() if "ray_process" in " ".join(below.cmdline())
    )


def wait_until(condition, what: str) -> None:
    deadline = time.monotonic() + deadlines.PROCESS_S
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain: {what}"
        time.sleep(0.05)


def wait_for_more(client: Client, campaign: int) -> None:
    """Until some more results are there."""
    before = client.campaigns.get(campaign).counts.completed
    wait_until(
        lambda: client.campaigns.get(campaign).counts.completed >= before + 10, "results come"
    )


@pytest.mark.fault(
    "SIGKILL of Ray's own processes",
    group="processes",
    outcome="Ray's driver reports every half second; without a raylet or a head, or after 30 "
    "s of silence, the services kill it and start another, with a Ray of one machine "
    "as well. Events `ray.lost` and `ray.back`; the campaign keeps its digest.",
)
def test_workers_come_with_the_work_outlive_ray_and_go_with_it(
    fresh_service, ray_folder, tmp_path
) -> None:
    """Ray is killed with all its workers in the middle, and what drives it after that."""
    span = Span(0, 2, idle_s=1.0)
    with fresh_service(Launcher.RAY, span=span) as service, Client(service.address.url) as client:
        assert client.present_workers() == ()
        undisturbed = find_digest(client, client.campaigns.create(**SHORT).id)
        campaign = client.campaigns.create(**SHORT)
        wait_for_more(client, campaign.id)
        raylet = next(p for p in driver(service).children() if p.name() == "raylet")
        for process in (raylet, *raylet.children(recursive=True)):  # else its workers run on
            with suppress(psutil.NoSuchProcess):  # it has died of its parent's death
                process.kill()
        wait_until(lambda: "Ray is back" in client.staffing().said, "another Ray is started")
        wait_for_more(client, campaign.id)
        driver(service).kill()
        assert find_digest(client, campaign.id) == undisturbed
        wait_until(lambda: client.present_workers() == (), "who has nothing to do goes")
        wait_until(lambda: actors(service) == [], "and so does its process")
        log = service.parts[1].log.read_text()
        assert len([*ray_folder.iterdir()]) == 1  # the folder of the third Ray
    assert [*ray_folder.iterdir()] == []
    assert "Ray's process raylet has died." in log
    assert "The process of Ray's driver ended with status -9." in log
    found = reader.read(f"sqlite:///{tmp_path}/data/eigenfail.db")
    assert (found.lost, found.doubled, found.complaints) == (0, 0, ())


def test_a_service_that_still_waits_for_ray_ends_when_it_is_told_to(tmp_path) -> None:
    """Somebody listens at the cluster's address, and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        command = [sys.executable, "-m", "eigenfail_services", "--ray-address", address]
        database = ["--database", f"sqlite:///{tmp_path}/e.db"]
        with subprocess.Popen([*command, *database], stderr=subprocess.PIPE, text=True) as process:
            silent.settimeout(deadlines.PROCESS_S)
            silent.accept()[0].close()
            below = psutil.Process(process.pid).children(recursive=True)
            process.terminate()
            _, said = process.communicate(timeout=deadlines.PROCESS_S)
    assert (process.returncode, "Traceback" in said) == (0, False)
    assert below
    assert psutil.wait_procs(below, timeout=deadlines.PROCESS_S)[1] == []


def test_a_cluster_that_is_not_there_is_said_in_one_sentence(tmp_path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "eigenfail_services", "--database", f"sqlite:///{tmp_path}/e.db",
         "--ray-address", "127.0.0.1:1"],
        capture_output=True, text=True, timeout=deadlines.PROCESS_S, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert "Ray cannot be used" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
