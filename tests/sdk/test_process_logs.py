"""What processes say of themselves: text or JSON, without keys; a full disk ends nobody."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")
KEY = f"ef_7_{'a' * 43}"

LOG = """
import structlog
from eigenfail import logs
logs.configure("services")
structlog.get_logger().warning("store unavailable")
print("alive")
"""
OTHERS = f"""
import logging, structlog
from eigenfail import logs
logs.configure("controller")
structlog.get_logger().info("episode errored", campaign=3, episode=14, worker="w")
try:
    raise ValueError("a key: {KEY}")
except ValueError:
    logging.getLogger("uvicorn.error").exception("trouble with %s", "{KEY}")
"""


def run(program, environment=None, stderr=subprocess.PIPE):
    command = [sys.executable, "-u", "-c", program]
    return subprocess.run(
        command, stdout=subprocess.PIPE, stderr=stderr, check=False, text=True, env=environment
    )


@pytest.mark.fault(
    "disk of a log full",
    group="storage",
    outcome="Log lines are lost; no process ends because of them.",
)
@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
def test_who_complains_of_a_full_disk_is_not_ended_by_it():
    with FULL.open("w") as full:
        assert run(LOG, stderr=full).stdout == "alive\n"


def test_as_json_every_line_says_what_it_is_about(monkeypatch):
    monkeypatch.setenv("EIGENFAIL_LOG_FORMAT", "json")
    done = run(OTHERS)
    ours, others = map(json.loads, done.stderr.splitlines())
    assert ours.pop("timestamp").endswith("Z")
    assert ours == {
        "process": "controller",
        "level": "info",
        "event": "episode errored",
        "campaign": 3,
        "episode": 14,
        "worker": "w",
    }
    assert others["process"] == "controller"
    assert others["level"] == "error"
    assert "ValueError" in others["exception"]
    assert KEY not in done.stderr


def test_as_text_others_are_heard_too(monkeypatch):
    monkeypatch.delenv("EIGENFAIL_LOG_FORMAT", raising=False)
    said = run(OTHERS).stderr
    assert "episode errored" in said
    assert "ERROR: trouble with" in said


def test_a_format_that_there_is_not_is_refused_by_name(monkeypatch):
    monkeypatch.setenv("EIGENFAIL_LOG_FORMAT", "xml")
    command = [sys.executable, "-m", "eigenfail_services", "--database", "sqlite://"]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    assert done.returncode == 2
    assert "EIGENFAIL_LOG_FORMAT" in done.stderr
    assert "Use text or json." in done.stderr
    assert "Traceback" not in done.stderr
