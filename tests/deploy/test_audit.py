"""What the audit of the packages finds."""

import importlib.util
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

SCRIPT = Path(__file__).parents[2] / "deploy" / "audit.py"


@pytest.fixture(scope="module")
def audit():
    """The script, as a module."""
    spec = importlib.util.spec_from_file_location("audit", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_lies_below_its_floor_is_told_with_the_advisory(audit):
    packages = audit.pinned(["# a remark", "Jinja2==3.1.5", "h11==0.16.0", "scikit_learn==1.4"])
    floors = {"jinja2": ("3.1.6", "A-1"), "h11": ("0.16.0", "A-2"), "scikit-learn": ("1.5", "A-3")}
    assert list(audit.too_old(packages, floors)) == [
        "jinja2 3.1.5: A-1; take 3.1.6 or later.",
        "scikit-learn 1.4: A-3; take 1.5 or later.",
    ]


def test_a_pin_is_read_without_its_hashes_and_its_local_label(audit):
    lines = ["# Written", "torch==2.13.0+cpu \\", "    --hash=sha256:a0 \\", "    --hash=sha256:b1"]
    assert audit.pinned(lines) == {"torch": Version("2.13.0")}


def test_pip_audit_is_given_every_package(audit, monkeypatch):
    script = (
        "import json, sys; text = open(sys.argv[-1]).read()"
        "; print(json.dumps({'dependencies': [{'name': 'all', 'version': text, 'vulns': []}]}))"
    )
    monkeypatch.setattr(audit, "PIP_AUDIT", (audit.sys.executable, "-c", script))
    packages = audit.read_locks(audit.LOCKS)
    told = audit.asked(packages)["dependencies"][0]["version"].splitlines()
    assert told == [f"{name}=={version}" for name, version in packages.items()]
    assert f"torch=={packages['torch']}" in told
    assert len(told) > 150


def test_published_flaws_are_told_with_what_mends_them(audit):
    flaw = {"id": "A-1", "fix_versions": ["2.1", "3.0"]}
    found = {
        "dependencies": [
            {"name": "a", "version": "2.0", "vulns": [flaw, {"id": "A-2", "fix_versions": []}]},
            {"name": "b", "version": "1.0", "vulns": []},
            {"name": "c", "skip_reason": "not found"},
        ]
    }
    assert list(audit.published(found)) == [
        "a 2.0: A-1; take 2.1 or 3.0.",
        "a 2.0: A-2; take another package.",
    ]


@pytest.mark.parametrize("told", ["raise SystemExit('no network')", "import time; time.sleep(9)"])
def test_without_advisories_the_floors_have_to_do(audit, monkeypatch, capsys, told):
    monkeypatch.setattr(audit, "PIP_AUDIT", (audit.sys.executable, "-c", told))
    monkeypatch.setattr(audit, "PATIENCE_S", 2)
    assert list(audit.published(audit.asked({}))) == []
    assert "the floors have to do" in capsys.readouterr().out


def test_every_floor_is_of_a_package_that_is_pinned(audit):
    floors = tomllib.loads(audit.FLOORS.read_text())["floors"]
    packages = audit.read_locks(audit.LOCKS)
    assert floors.keys() <= packages.keys()
    assert all(Version(least) and advisory for least, advisory in floors.values())
