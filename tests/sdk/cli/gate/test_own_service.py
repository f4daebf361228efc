"""`eigenfail gate` with a service of its own, and code that changes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from distributions import write_record

EIGENFAIL = Path(sys.executable).parent / "eigenfail"
PLANNER = (
    "from eigenfail_workers.planners.idm import *\n\n\nclass Planner(IntelligentDriver):\n    {}\n"
)
BLIND = "def _leads(self, ego, other):\n        return False"


@pytest.mark.service
def test_with_a_service_of_its_own_changed_code_is_seen_and_judged(tmp_path):
    points = "[eigenfail.planners]\ngated = gated_planner:Planner\n"
    write_record(tmp_path, "gated-planner", points)
    code = tmp_path / "gated_planner.py"
    suite = tmp_path / "suite.toml"
    suite.write_text(
        'name = "own"\n[base]\nmethod = "monte_carlo"\nplanner = "gated"\nepisodes = 12\n'
        'simulator = "point_mass"\nplanner_settings.lane_half_width_m = 3.0\n[grid]\nseed = [1]\n'
    )

    def gate(*words):
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        return subprocess.run(
            [EIGENFAIL, "gate", suite, "--workers", "1", "--data", "data", "--json", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )

    code.write_text(PLANNER.format("pass"))
    made = gate()
    assert made.returncode == 0, made.stderr
    version = json.loads(made.stdout)["gate"]["version"]
    code.write_text(PLANNER.format(BLIND))
    judged = gate("--baseline", version)
    assert judged.returncode == 1, judged.stderr
    report = json.loads(judged.stdout)
    assert report["gate"]["version"] != version
    rerun = report["members"][0]["rerun"]
    assert rerun["before"]["failures"] == 0 < rerun["now"]["failures"]
    assert rerun["counts"] == {"new": rerun["now"]["failures"]}
