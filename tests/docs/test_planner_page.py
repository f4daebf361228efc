"""What docs/planner.md says of the planner is what the planner is and does."""

import re
import subprocess
import sys

import pytest

from eigenfail_workers.planners.rulebook.candidates import CANDIDATES
from eigenfail_workers.planners.rulebook.driving_modes import DrivingMode
from eigenfail_workers.planners.rulebook.gaps import CHANGE_LANE, MERGE_EARLY, MERGE_LATE
from eigenfail_workers.planners.rulebook.merging import ABORT, COMMITMENT
from eigenfail_workers.planners.rulebook.overrides import Override
from eigenfail_workers.planners.rulebook.rules import HIERARCHY, UNOPPOSED


@pytest.fixture
def table(planner_page):
    return planner_page.text.split("<!-- sweep -->")[1].split("<!-- /sweep -->")[0].strip()


def test_it_names_every_mode_candidate_rule_and_override(planner_page):
    changes = (CHANGE_LANE, MERGE_EARLY, MERGE_LATE, ABORT)
    rules = (*(rule.name for rule in HIERARCHY), UNOPPOSED, COMMITMENT)
    names = [*DrivingMode, *CANDIDATES, *changes, *rules]
    overrides = [override for override in Override if override is not Override.NONE]
    missing = [name for name in (*names, *overrides) if f"`{name}`" not in planner_page.text]
    assert missing == []
    rows = re.findall(r"^\| `(\w+)` \| ", planner_page.text, re.MULTILINE)
    hierarchy = [rule.name for rule in HIERARCHY]
    assert [name for name in rows if name in hierarchy] == hierarchy


def test_its_parts_are_files(planner_page, root):
    folder = root / "workers" / "eigenfail_workers" / "planners" / "rulebook"
    parts = planner_page.text.split("| part | what it does |")[1].split("##")[0]
    named = [name for row in parts.splitlines() for name in re.findall(r"`(\w+)`", row[:40])]
    assert len(named) >= 9
    for name in named:
        if name not in ("steering", "idm"):
            assert (folder / f"{name}.py").exists(), name


def test_its_table_is_what_the_script_prints(table, root):
    script = [sys.executable, root / "benchmarks" / "planner_table.py", "58"]
    printed = subprocess.run(script, capture_output=True, text=True, check=True).stdout.splitlines()
    header, rule, *rows = table.splitlines()
    assert printed[:2] == [header, rule]
    (row,) = [line for line in rows if line.startswith("| 58 ")]
    assert printed[2:] == [row]


def test_its_table_shows_a_calm_and_safe_driver(table):
    _, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert [row[0] for row in rows] == ["52", "58", "70"]
    for _, runs, collisions, overridden, unsolved, acceleration, jerk, *_, slowest, _ in rows:
        assert (int(runs), collisions, overridden, unsolved) == (243, "0", "0", "0")
        assert float(acceleration.split()[0]) >= -2.0
        assert float(jerk) <= 4.0
        assert float(slowest) > 10.0
