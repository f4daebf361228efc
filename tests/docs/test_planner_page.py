"""What docs/planner.md says of the planner is what the planner is and does."""

import re

from eigenfail_workers.planners.rulebook.candidates import CANDIDATES
from eigenfail_workers.planners.rulebook.lanes import ABORT, COMMITMENT
from eigenfail_workers.planners.rulebook.rules import HIERARCHY, UNOPPOSED
from eigenfail_workers.planners.rulebook.traffic import CHANGE_LANE, MERGE_EARLY, MERGE_LATE
from eigenfail_workers.planners.rulebook.values import DrivingMode, Override


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
