"""The port at which the services are scraped: loopback, unless somebody vouches for the network."""

import socket
import subprocess
import sys
from urllib.request import urlopen

import deadlines
import pytest

from eigenfail.errors import InvalidValue, PortTaken
from eigenfail_services.hub.metrics import HubStatus, Metrics
from eigenfail_services.observability import serve, split_address


@pytest.fixture
def free():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    return f"127.0.0.1:{port}"


def test_the_figures_are_served_until_that_is_ended(free):
    metrics = Metrics()
    metrics.status = HubStatus(workers=2)
    end = serve(free, metrics.registry)
    with urlopen(f"http://{free}/metrics") as answer:
        lines = answer.read().decode().splitlines()
    assert "eigenfail_workers 2.0" in lines
    assert any(line.startswith("process_resident_memory_bytes ") for line in lines)
    end()
    with pytest.raises(OSError, match="refused"):
        urlopen(f"http://{free}/metrics")


def test_a_taken_port_is_told(free):
    host, port = split_address(free)
    with socket.create_server((host, port)), pytest.raises(PortTaken, match=free):
        serve(free, Metrics().registry)


@pytest.mark.parametrize("address", ["", "8442", "127.0.0.1", "127.0.0.1:", "localhost:x", "a:0"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(InvalidValue, match="metrics"):
        split_address(address)


def test_other_machines_reach_it_only_where_somebody_vouches(monkeypatch):
    monkeypatch.delenv("EIGENFAIL_TRUST_NETWORK", raising=False)
    for address in ("0.0.0.0:8442", "[::]:8442", "localhost.example:8442", "127.example:8442"):
        with pytest.raises(InvalidValue, match="requires no key"):
            split_address(address)
    assert split_address("localhost:8442") == ("localhost", 8442)
    monkeypatch.setenv("EIGENFAIL_TRUST_NETWORK", "1")
    assert split_address("0.0.0.0:8442") == ("0.0.0.0", 8442)
    assert split_address("[::1]:8442") == ("::1", 8442)


def test_a_wrong_address_is_told_in_a_sentence(tmp_path):
    database = f"sqlite:///{tmp_path}/e.db"
    command = [sys.executable, "-m", "eigenfail_services", "--database", database]
    command += ["--launcher", "none", "--metrics", "nowhere"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=deadlines.PROCESS_S
    )
    assert done.returncode == 2
    assert "'nowhere' is no address" in done.stderr
    assert "Traceback" not in done.stderr
