"""Which heavy packages each kind of process imports: a fleet pays for them with every start.

A service runs campaigns of three methods, an analysis and an export with a worker of its
own machine, and another one a campaign with a worker of Ray. Their processes, and those of the
command line, record what they import.
"""

import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import deadlines
import pytest
from stage import CAMPAIGNS, SEED

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, Plan, local_service
from eigenfail.values.campaign import CampaignState

pytestmark = pytest.mark.service

HEAVY = (
    *("torch", "ray", "gymnasium", "stable_baselines3", "highway_env", "osqp", "scipy", "sklearn"),
    *("pandas", "pyarrow", "matplotlib", "fastapi", "uvicorn", "sqlalchemy"),
)
"""Alembic is not among them: it is imported by whichever process makes the schema first."""

STORE = {"sqlalchemy"}
SOLVER = {"osqp", "scipy"}
"""OSQP takes its matrices from scipy."""
RAY = {"ray", "pyarrow"}
"""Ray imports pyarrow with its first message, where that is installed."""

TABLE: dict[str, set[str]] = {
    "eigenfail --help": set(),
    "eigenfail campaign list": set(),
    "guard of the service": set(),
    "services": STORE,
    "learner of monte_carlo": set(),
    "learner of ast": set(),
    "learner of difs": {"torch"},
    # scikit-learn imports pandas, and pandas pyarrow, where they are installed.
    "analysis": STORE | {"scipy", "sklearn", "pandas", "pyarrow"},
    "API: start": STORE | {"fastapi", "uvicorn"},
    # A planner's settings come with its class. The planner's module imports the solver at once: an
    # import within the first episode would be part of the time that is measured of it.
    "API: campaigns and analyses": SOLVER,
    # pyarrow imports pandas as it makes a table.
    "API: exports": {"pyarrow", "pandas"},
    "worker": set(),
    "child of a worker": SOLVER,
    "driver of Ray": RAY,
    "worker of Ray": RAY,
}
"""All heavy packages that a process of each kind imports; of the API, those that a step adds."""

KINDS = {
    "eigenfail.hosting.processes": "guard of the service",
    "eigenfail_api": "API",
    "eigenfail_services": "services",
    "eigenfail_services analyse": "analysis",
    "eigenfail_services.hub.learner_process": "learner",
    "eigenfail_services.campaigns.ray_process": "driver of Ray",
    "eigenfail_workers": "worker",
    "eigenfail_workers.worker.child": "child of a worker",
    "eigenfail --help": "eigenfail --help",
    "eigenfail campaign list": "eigenfail campaign list",
}
"""Kinds of processes by those words behind `python -m` that tell them apart."""

RAY_WORKER = "default_worker.py"
"""The program in which Ray runs an actor."""

RECORDER = """
import json, os, sys

noted = set()

def note(package):
    noted.add(package)
    with open({file!r}, "a") as stream:
        stream.write(json.dumps([sys.orig_argv, package]) + "\\n")

def record(event, arguments):
    if event == "import":
        package = arguments[0].partition(".")[0]
        if package in {heavy!r} and package not in noted:
            note(package)

note("")
sys.addaudithook(record)
"""
"""What every process runs first that finds it on its path, by the name of `sitecustomize`."""


class Recorder:
    """Records the heavy packages that processes import.

    Args:
        folder: folder that those processes have on their path.

    Attributes:
        found: packages by row of the table.
    """

    def __init__(self, folder: Path) -> None:
        self.found: defaultdict[str, set[str]] = defaultdict(set)
        self._file = folder / "imports"
        self._taken = 0
        text = RECORDER.format(heavy=HEAVY, file=str(self._file))
        (folder / "sitecustomize.py").write_text(text)

    def take(self, **rows: str) -> None:
        """Add the imports since the last time to the rows of these kinds of processes.

        Args:
            rows: the row of a kind, where it is not the kind itself; empty for none.
        """
        with self._file.open("rb") as stream:
            stream.seek(self._taken)
            lines, newline, _ = stream.read().rpartition(b"\n")
        self._taken += len(lines) + len(newline)
        for line in lines.splitlines():
            command, package = json.loads(line)
            kind = find_kind(command)
            if row := rows.get(kind, kind):
                self.found[row] |= {package} - {""}


def find_kind(command: list[str]) -> str:
    """Return the kind of a process; empty for programs that are not of this project.

    Raises:
        KeyError: the process is of a kind that has no name here.
    """
    if any(word.endswith(RAY_WORKER) for word in command):
        return "worker of Ray"
    if "-m" not in command:
        return ""
    module, *words = command[command.index("-m") + 1 :]
    if module == "eigenfail":
        return KINDS[" ".join([module, *words])]
    return KINDS[f"{module} analyse" if "analyse" in words else module]


def run_campaign(client: Client, **fields: Any) -> int:
    """Run a campaign to its end; its id."""
    campaign = client.campaigns.create(**{"name": "imports", "seed": SEED} | fields).id
    ended = client.campaigns.wait(campaign, timeout_s=deadlines.CAMPAIGN_S)
    assert (ended.state, ended.counts.errored) == (CampaignState.DONE, 0)
    return campaign


def use_local_service(recorder: Recorder, folder: Path) -> None:
    """Do what users do with a service whose worker is a process of this machine."""
    plan = Plan(folder / "local", port=0, launcher=Launcher.LOCAL, workers=1)
    with local_service(plan) as service, Client(service.address.url) as client:
        recorder.take(API="API: start")
        for method, fields in CAMPAIGNS.items():
            simple = fields | {"planner": "idm", "simulator": "point_mass", "episodes": 18}
            real = {"method": method, "planner": "rulebook", "episodes": 8}
            campaign = run_campaign(client, **real if method == "monte_carlo" else simple)
            recorder.take(API="API: campaigns and analyses", learner=f"learner of {method}")
        analysis = client.analyses.create(campaign).id
        assert client.analyses.wait(analysis, timeout_s=deadlines.CAMPAIGN_S).result
        for words in (["--help"], ["campaign", "list"]):
            command = [sys.executable, "-m", "eigenfail", *words]
            named = os.environ | {"EIGENFAIL_URL": service.address.url}
            subprocess.run(command, env=named, capture_output=True, check=True)
        recorder.take(API="API: campaigns and analyses")
        client.episodes.export(campaign, folder / "episodes.parquet")
    recorder.take(API="API: exports")


def use_ray(recorder: Recorder, folder: Path) -> None:
    """Run a campaign with a worker of Ray. Its API does what that of the other service did."""
    plan = Plan(folder / "ray", port=0, launcher=Launcher.RAY, workers=1)
    with local_service(plan) as service, Client(service.address.url) as client:
        run_campaign(client, method="monte_carlo", planner="rulebook", episodes=8)
    recorder.take(API="", learner="learner of monte_carlo")


@pytest.fixture(scope="module")
def imports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """All packages that processes imported, by row of the table."""
    folder = tmp_path_factory.mktemp("imports")
    recorder = Recorder(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder))  # without the plug-ins of other tests
        patch.delenv("EIGENFAIL_FUNCTIONS")
        use_local_service(recorder, folder)
        use_ray(recorder, folder)
    return recorder.found


@pytest.mark.parametrize("row", TABLE)
def test_a_process_imports_what_it_needs_and_nothing_else(imports, row) -> None:
    assert imports[row] == TABLE[row]


def test_every_kind_of_process_has_its_row(imports) -> None:
    assert set(imports) == set(TABLE)
