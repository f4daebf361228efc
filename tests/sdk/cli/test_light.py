"""The SDK and the command line need nothing of what the service and the workers need."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")

HEAVY = (
    *("torch", "ray", "fastapi", "sqlalchemy", "alembic", "zmq", "sklearn", "scipy"),
    *("stable_baselines3", "highway_env", "gymnasium", "osqp", "uvicorn", "starlette", "pydantic"),
    *("eigenfail_api", "eigenfail_services", "eigenfail_workers"),
)

IMPORT_ALL = f"""
import importlib, pkgutil, sys

class Refuses:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY!r}:
            raise ImportError(f"the SDK asked for {{name}}")

sys.meta_path.insert(0, Refuses())
import eigenfail
seen = [module.name for module in pkgutil.walk_packages(eigenfail.__path__, "eigenfail.")]
for name in seen:
    if not name.startswith(sys.argv[1]):
        importlib.import_module(name)
print(len(seen))
"""

NOTHING = "-"
TESTING = "eigenfail.testing"
"""For authors of plug-ins, who have pytest."""


def test_no_module_of_the_sdk_imports_what_is_heavy():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL, NOTHING], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 40


def test_the_refusal_refuses():
    script = IMPORT_ALL.replace("import eigenfail\n", "import fastapi\n")
    done = subprocess.run(
        [sys.executable, "-c", script, NOTHING], capture_output=True, text=True, check=False
    )
    assert "the SDK asked for fastapi" in done.stderr


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A virtual environment with the bare distribution."""
    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    pip = [*PIP, "--python", folder / "bin" / "python", "--quiet"]
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = folder / "pins.txt"  # pip has no hash for a folder, and with one hash it wants them all
    pins.write_text("".join(f"{line.split()[0]}\n" for line in lines if "==" in line))
    options = ("--no-compile", "--constraint", pins)
    subprocess.run([*pip, "install", *options, ROOT], check=True, cwd=folder)
    return folder / "bin"


def run(*words):
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.mark.service
def test_the_bare_distribution_has_nothing_heavy_and_works_without(bare, tmp_path):
    listing = (*PIP, "--python", bare / "python", "list", "--format", "json")
    listed = json.loads(run(*listing).stdout)
    installed = {package["name"].lower() for package in listed}
    assert "eigenfail" in installed
    assert installed.isdisjoint({"torch", "ray", "fastapi", "sqlalchemy", "pyzmq", "scikit-learn"})

    imported = run(bare / "python", "-c", IMPORT_ALL, TESTING)
    assert imported.returncode == 0, imported.stderr

    helped = run(bare / "eigenfail", "--help")
    assert helped.returncode == 0
    assert "campaign" in helped.stdout

    refused = run(bare / "eigenfail", "up", "--data", tmp_path / "data")
    assert refused.returncode == 3
    assert "pip install '.[server,worker]'" in refused.stderr
    assert "Traceback" not in refused.stderr

    worker = run(bare / "eigenfail", "worker", "--connect", "tcp://127.0.0.1:1")
    assert worker.returncode == 3
    assert "pip install '.[worker]'" in worker.stderr
