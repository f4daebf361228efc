"""A log that finds no room ends nobody."""

import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")

LOG = """
import structlog
from eigenfail_services import logs
logs.configure()
structlog.get_logger().warning("store unavailable")
print("alive")
"""


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full is Linux's")
def test_who_complains_of_a_full_disk_is_not_ended_by_it() -> None:
    with FULL.open("w") as full:
        command = [sys.executable, "-u", "-c", LOG]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=full, check=False, text=True)
    assert done.stdout == "alive\n"
