"""`eigenfail doctor --planner`: each way to break the contract is found, and named in words."""

import json
import time
from itertools import count

import msgspec
import numpy as np
import pytest

from eigenfail.cli import plugin_checks
from eigenfail.testing import planner as suite
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail.values.scene import Control


class Good:
    """Keeps its contract."""

    class Settings(msgspec.Struct, frozen=True):
        brake_mps2: float = 0.5

    def __init__(self, settings):
        self.brake_mps2 = settings.brake_mps2

    def reset(self, mission):
        self.steps = 0

    def act(self, perception):
        self.steps += 1
        return Control(-self.brake_mps2, 0.001 * self.steps)


class Unsettled(Good):
    Settings = None


class Demanding(Good):
    class Settings(msgspec.Struct, frozen=True):
        brake_mps2: float


class Mute(Good):
    def act(self, perception):
        return None


class Infinite(Good):
    def act(self, perception):
        return Control(float("inf"), 0.0)


class Undefined(Good):
    """Goes wrong only where it looks closely: late, and in the steering."""

    def act(self, perception):
        control = super().act(perception)
        late = self.steps == suite.STEPS
        return Control(control.acceleration_mps2, float("nan")) if late else control


class Moody(Good):
    numbers = count()

    def act(self, perception):
        return Control(-1.0, 1e-9 * next(self.numbers))


class Nostalgic(Good):
    steps = 0

    def reset(self, mission):
        """Keeps counting."""


class Meddler(Good):
    def act(self, perception):
        msgspec.structs.force_setattr(perception, "time_s", 0.0)
        return super().act(perception)


class Rewriter(Good):
    def reset(self, mission):
        msgspec.structs.force_setattr(mission, "speed_limit_mps", 99.0)
        super().reset(mission)


class Thinker(Good):
    def act(self, perception):
        time.sleep(2e-4)
        return super().act(perception)


class Endless(Good):
    def act(self, perception):
        time.sleep(0.5)
        return super().act(perception)


class Confused(Good):
    def explain(self):
        self.steps += 1
        return {"mode": "highway"}


class Cryptic(Good):
    def explain(self):
        return {"seen": object()}


class Signalling(Good):
    signal_names = ("steps", "gap_m")

    def signals(self):
        return {"steps": self.steps, "gap_m": np.float32(3.5)}


class Unnamed(Signalling):
    signal_names = "gap_m"


class Silent(Signalling):
    def signals(self):
        return {"steps": self.steps}


class Boolean(Signalling):
    def signals(self):
        return {"steps": self.steps, "gap_m": self.steps < 40}


class Thoughtless(Good):
    def act(self, perception):
        np.seterr(all="raise")
        return super().act(perception)


class Clumsy(Good):
    def act(self, perception):
        raise KeyError("lead")


@pytest.fixture
def examine(eigenfail, monkeypatch):
    """Examines a class of this file; the exit code, and the checks by name."""

    def run(planner, *words):
        monkeypatch.setattr(plugin_checks.plugins, "load_class", lambda place: planner)
        told = eigenfail("doctor", "--planner", f"here:{planner.__name__}", "--json", *words)
        return told.exit_code, {check["check"]: check for check in json.loads(told.stdout)}

    return run


def said(checks, verdict="broken"):
    return {name: check["said"] for name, check in checks.items() if check["verdict"] == verdict}


@pytest.mark.parametrize("planner", [Good, Signalling])
def test_a_planner_that_keeps_its_contract_passes(examine, planner):
    code, checks = examine(planner)
    assert code == 0
    assert len(said(checks, "passed")) == len(PLANNER_CHECKS) + 1
    place = f"here:{planner.__name__}"
    assert all(check["plugin"] == place and check["said"] for check in checks.values())


@pytest.mark.parametrize(
    ("planner", "check", "words", "alone"),
    [
        (Mute, "returns finite controls", "returned None, not a Control", True),
        (Infinite, "returns finite controls", "acceleration_mps2=inf", True),
        (Undefined, "returns finite controls", "steering_rad=nan", True),
        (Thoughtless, "leaves its process alone", "numpy's error state", True),
        (Moody, "is deterministic", "answered the same perceptions differently", False),
        (Nostalgic, "forgets at reset", "it kept something", True),
        (Meddler, "leaves its input alone", "changed a perception", True),
        (Rewriter, "leaves its input alone", "changed the mission", True),
        (Confused, "explains without a trace", "drives otherwise", True),
        (Cryptic, "explains without a trace", "'seen'", True),
        (Clumsy, "returns finite controls", "It raised KeyError: 'lead'.", False),
        (Unnamed, "reports finite signals", "is gap_m, not a tuple of names", False),
        (Silent, "reports finite signals", "'gap_m' is None, not a finite number", False),
        (Boolean, "reports finite signals", "'gap_m' is True, not a finite number", False),
    ],
)
def test_what_breaks_the_contract_is_said_in_words(*, examine, planner, check, words, alone):
    """Whoever breaks one thing alone is blamed for nothing else."""
    code, checks = examine(planner)
    assert code == 1
    assert words in said(checks)[check]
    assert len(said(checks)) == 1 or not alone


def test_a_slow_planner_is_told_its_budget(examine, monkeypatch):
    monkeypatch.setattr(suite, "DECISION_S", 1e-4)
    code, checks = examine(Thinker)
    assert code == 1
    (slow,) = said(checks).items()
    assert slow[0] == "decides in time"
    assert "the budget is 0.0001 s" in slow[1]


def test_what_never_ends_is_not_waited_for(examine, monkeypatch):
    monkeypatch.setattr(plugin_checks, "PATIENCE_S", 0.1)
    code, checks = examine(Endless)
    assert code == 1
    assert said(checks) == {"leaves its process alone": "It did not finish within 0.1 s."}
    assert len(said(checks, "skipped")) == len(PLANNER_CHECKS) - 1


@pytest.mark.parametrize(("planner", "words"), [(Unsettled, "Settings"), (Demanding, "brake_mps2")])
def test_without_settings_nothing_else_is_checked(examine, planner, words):
    code, checks = examine(planner)
    assert code == 1
    assert words in said(checks)["has Settings"]
    assert len(said(checks, "skipped")) == len(PLANNER_CHECKS)


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        (("--planner", "idm", "--replay", "3"), "--replay: cannot be combined with --planner"),
        (("--scenario", "cut_in", "--replay", "3"), "--replay: cannot be combined with --scenario"),
        (
            ("--bridge", "tcp://127.0.0.1:1", "--planner", "idm"),
            "--planner: cannot be combined with",
        ),
        (
            ("--bridge", "tcp://127.0.0.1:1", "--replay", "3"),
            "--replay: cannot be combined with --bridge",
        ),
    ],
)
def test_what_would_be_left_out_is_refused(eigenfail, words, refused):
    told = eigenfail("doctor", *words)
    assert (told.exit_code, refused in told.stderr) == (2, True)


def test_people_get_a_table(eigenfail):
    told = eigenfail("doctor", "--planner", "test_returns_nan")
    assert told.exit_code == 1
    row = next(line for line in told.stdout.splitlines() if "returns finite controls" in line)
    assert row.split()[0] == "broken"
    assert "acceleration_mps2=nan" in row
    assert "is deterministic" in told.stdout
    assert told.stdout.count("broken ") == 1


def test_a_scenario_is_checked_alike_and_both_at_once(eigenfail):
    told = eigenfail("doctor", "--scenario", "cut_in", "--planner", "idm", "--json")
    assert told.exit_code == 0, told.output
    verdicts = [check["verdict"] for check in json.loads(told.stdout)]
    assert verdicts == ["passed"] * (len(PLANNER_CHECKS) + len(SCENARIO_CHECKS) + 2)


LEAVING_OUT = """
from eigenfail_workers.scenarios.cut_in import CutIn

class Mine(CutIn):
    left_out = {left_out}
    notes = ("Elements that are not read: lanelet (1).",)
"""


def test_vehicles_that_a_scenario_leaves_out_do_not_pass(eigenfail, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for module, left_out in (("leaves", ["'3': It has no rectangle."]), ("keeps", [])):
        (tmp_path / f"{module}.py").write_text(LEAVING_OUT.format(left_out=left_out))
        told = eigenfail("doctor", "--scenario", f"{module}:Mine", "--json")
        assert told.exit_code == len(left_out), told.output
        checks = json.loads(told.stdout)
        broken = [check["said"] for check in checks if check["verdict"] == "broken"]
        assert len(broken) == len(left_out)
        assert all("'3': It has no rectangle" in said for said in broken)
        noted = [check["said"] for check in checks if check["verdict"] == "noted"]
        assert "lanelet (1)" in noted[0]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("rulebok", "Did you mean 'rulebook'?"),
        ("no_such_module:Planner", "No module named 'no_such_module'"),
        ("os:NoSuchPlanner", "has no attribute 'NoSuchPlanner'"),
        ("bad planner:X", "not of the form module:Class"),
        ("wrong_syntax:X", "SyntaxError"),
        ("wrong_start:X", "ZeroDivisionError"),
    ],
)
def test_what_cannot_be_loaded_exits_with_2(eigenfail, place, words, tmp_path, monkeypatch):
    (tmp_path / "wrong_syntax.py").write_text("def (")
    (tmp_path / "wrong_start.py").write_text("1 / 0")
    monkeypatch.chdir(tmp_path)
    told = eigenfail("doctor", "--planner", place)
    assert told.exit_code == 2
    assert words in told.stderr
    assert told.stdout == ""
