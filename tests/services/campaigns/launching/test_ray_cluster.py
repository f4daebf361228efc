"""How a Ray of this machine is started: with its token on, its dashboard off, and on loopback.

Ray itself is not started here: what it is asked for is. With a real one: tests/integration.
"""

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from eigenfail.hosting.service import Launcher, Plan, make_commands
from eigenfail_services import __main__ as services
from eigenfail_services import options
from eigenfail_services.campaigns.ray_process import ALONE, ENVIRONMENT, RayCluster

WANTED = ("RAY_AUTH_MODE", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER")


@pytest.fixture
def begun(monkeypatch):
    """With what Ray was begun: its options, and its variables by then."""
    for name in ENVIRONMENT | ALONE:
        monkeypatch.setenv(name, "")  # so that it is as it was, afterwards
        monkeypatch.delenv(name)
    calls = []

    def init(**given):
        calls.append(given | {name: os.environ.get(name) for name in WANTED})

    context = SimpleNamespace(get_node_id=lambda: "a")
    ray = SimpleNamespace(init=init, get_runtime_context=lambda: context)
    monkeypatch.setitem(sys.modules, "ray", ray)
    return calls


def test_it_asks_for_a_token_shows_no_dashboard_and_stays_on_loopback(begun):
    RayCluster(None, 3)
    (given,) = begun
    assert given["RAY_AUTH_MODE"] == "token"
    assert given["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] == "0"
    assert given["include_dashboard"] is False
    assert given["_node_ip_address"] == "127.0.0.1"
    assert given["num_cpus"] == 3
    assert "dashboard_host" not in given


def test_a_ray_of_one_machine_has_logs_of_bounded_size_in_the_folder_that_it_is_given(begun):
    RayCluster(None, 3, "/tmp/ray-of-mine")
    (given,) = begun
    assert given["_temp_dir"] == "/tmp/ray-of-mine"
    assert int(os.environ["RAY_ROTATION_MAX_BYTES"]) == 5_000_000
    assert int(os.environ["RAY_ROTATION_BACKUP_COUNT"]) == 1


def test_one_that_runs_elsewhere_is_spoken_with_by_token_too(begun, monkeypatch):
    monkeypatch.setattr("eigenfail_services.campaigns.ray_process.check_reachable", lambda _: None)
    RayCluster("head:6379", 3)
    (given,) = begun
    assert (given["RAY_AUTH_MODE"], given["address"]) == ("token", "head:6379")


def test_up_has_ray_started_so_and_nobody_else():
    words = make_commands(Plan(Path("data"), 0, 2, Launcher.RAY), "sqlite://", 8440, 8441)[
        "services"
    ]
    arguments = services.parse(words[words.index("eigenfail_services") + 1 :])
    assert (arguments.launcher, arguments.ray_address) == ("ray", None)
    assert options.create_launcher(arguments)
