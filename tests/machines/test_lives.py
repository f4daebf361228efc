"""The lives of machines are the same ones always, or those of a seed where one explores."""

import re
from pathlib import Path

import lives
import pytest

pytest_plugins = ["pytester"]

MACHINE = """
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test
from conftest import lives

LIVED = []

class Machine(RuleBasedStateMachine):
    @rule(n=st.integers())
    def live(self, n):
        LIVED.append(n)

def test_lives():
    run_state_machine_as_test(Machine, settings=lives(5, 10))
    print("LIVED", LIVED)
"""


@pytest.fixture
def lived(pytester, monkeypatch):
    """What the machine lives with a seed."""
    pytester.makeconftest(Path(lives.__file__).read_text())
    pytester.makepyfile(MACHINE)
    monkeypatch.setenv("PYTHONPATH", str(pytester.path))

    def run(seed, exploring):
        monkeypatch.setenv(lives.VARIABLE, str(int(exploring)))
        told = pytester.runpytest_subprocess("-s", "-p", "conftest", f"--hypothesis-seed={seed}")
        told.assert_outcomes(passed=1)
        return re.search("LIVED (.*)", told.stdout.str())[1]

    return run


def test_they_are_the_same_ones_unless_one_explores_and_then_those_of_the_seed(lived) -> None:
    same, still = (lived(seed, exploring=False) for seed in (1, 2))
    assert same == still
    first, second, again = (lived(seed, exploring=True) for seed in (1, 2, 1))
    assert first == again != second
    assert len(first.split()) > len(same.split())
