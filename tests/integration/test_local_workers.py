"""Workers that the services start on their machine: killed, replaced, gone at the end."""

import psutil
import pytest
from killed_worker import check_gone, check_replacement, list_descendants

from eigenfail.hosting.service import Launcher
from eigenfail_services.hub.keys import KeyFolder

pytestmark = pytest.mark.service

FIELDS = {"name": "local", "method": "monte_carlo", "planner": "idm", "episodes": 400, "seed": 8}


def list_workers(service) -> list[psutil.Process]:
    """The parent processes of the workers of a service."""
    services = psutil.Process(service.parts[1].process.pid)
    return [one for one in services.children() if "eigenfail_workers" in one.cmdline()]


@pytest.mark.fault(
    "SIGKILL of a worker that the services started",
    group="processes",
    outcome="They start another one of its name after a second, and its episodes go to others"
    " meanwhile. The campaign keeps its digest.",
)
def test_a_killed_local_worker_is_replaced_and_changes_nothing(fresh_service, tmp_path) -> None:
    """On a hub that asks for keys, which they get from the service."""
    KeyFolder(tmp_path / "data" / "hub-keys").create("by-hand", tmp_path / "by-hand.key")
    with fresh_service(Launcher.LOCAL, workers=2) as service:
        names = {process.cmdline()[-3] for process in list_workers(service)}
        check_replacement(service, FIELDS, list_workers)
        assert {process.cmdline()[-3] for process in list_workers(service)} == names
        everything = list_descendants(service)
    check_gone(everything)
