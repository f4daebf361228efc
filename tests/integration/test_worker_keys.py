"""A service that asks workers for keys, as real processes: who works, who does not, what leaks."""

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import deadlines
import psutil
import pytest
from zmq.utils import z85

from eigenfail.client import Client
from eigenfail.files import read_private
from eigenfail.hosting.service import Launcher
from eigenfail.values.campaign import CampaignState
from eigenfail.wire.keys import encode_key, read_worker_key
from eigenfail_services.hub.keys import KeyFolder

pytestmark = pytest.mark.service

PROGRAM = (sys.executable, "-m", "eigenfail_workers", "--name", "w")
FIELDS = {
    "name": "keyed", "method": "monte_carlo", "planner": "idm", "simulator": "point_mass",
    "episodes": 6, "seed": 8,
}  # fmt: skip


def worker(*words: str | Path, log: Path) -> subprocess.Popen:
    with log.open("wb") as stream:
        return subprocess.Popen([*PROGRAM, *words], stdout=stream, stderr=subprocess.STDOUT)


def everything_shown(folder: Path, process: subprocess.Popen) -> str:
    """The logs of service and worker, and the arguments of all processes of this test."""
    logs = "".join(log.read_text() for log in folder.rglob("*.log"))
    arguments = {}
    for each in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # one that has ended
            arguments[each.pid] = " ".join(each.cmdline())
    assert "--key-file" in arguments[process.pid]
    return logs + "".join(arguments.values())


def test_only_workers_with_a_key_work_and_no_secret_is_seen(fresh_service, tmp_path) -> None:
    keys, file = KeyFolder(tmp_path / "data" / "hub-keys"), tmp_path / "w.key"
    keys.create("w", file)
    key = read_worker_key(read_private(file, ""), "")
    with fresh_service(Launcher.NONE) as service, Client(service.address.url) as client:
        hub = ("--connect", service.address.hub)
        keyless = worker(*hub, log=tmp_path / "keyless.log")
        working = worker(*hub, "--key-file", file, log=tmp_path / "w.log")
        ended = client.campaigns.wait(
            client.campaigns.create(**FIELDS).id, timeout_s=deadlines.CAMPAIGN_S
        )
        assert (ended.state, ended.counts.completed) == (CampaignState.DONE, 6)
        shown = everything_shown(tmp_path, working)
        assert keyless.wait(deadlines.PROCESS_S) in {2, 3}
        working.terminate()
        assert working.wait(deadlines.PROCESS_S) == 0
    assert "worker authenticated" in shown
    for secret in (key.secret, keys.secret()):
        told = (z85.encode(secret).decode(), encode_key(secret), secret.hex(), repr(secret)[2:-1])
        assert [text for text in (*told, key.text()) if text in shown] == []
    assert "Traceback" not in (last := (tmp_path / "keyless.log").read_text())
    assert "--key-file" in last.splitlines()[-1]
