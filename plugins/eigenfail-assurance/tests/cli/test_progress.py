"""What commands say of steps that may last."""

from pathlib import Path

import pytest

from eigenfail import progress

EXAMPLES = Path(__file__).parents[2] / "examples"

WAITING_COMMANDS = {
    "evidence {examples}/evidence.toml -o {tmp}/evidence": "Collecting the evidence",
    "evidence verify {tmp}": "Verifying {tmp}",
    "risk {examples}/risk.toml": "Assessing the risk",
    "risk next {examples}/risk.toml": "Assessing the risk",
}


@pytest.fixture
def steps(monkeypatch):
    """The steps of commands that are announced if they last."""
    begun = []

    class Recorded(progress.WaitingLines):
        def __init__(self, step):
            super().__init__(step)
            begun.append(step)

    monkeypatch.setattr(progress, "WaitingLines", Recorded)
    return begun


@pytest.mark.parametrize("command", WAITING_COMMANDS)
def test_a_command_that_may_take_long_announces_its_step(command, eigenfail, done, steps, tmp_path):
    places = {"tmp": tmp_path, "examples": EXAMPLES}
    steps.clear()
    eigenfail(*command.format(**places).split())
    assert WAITING_COMMANDS[command].format(**places) in steps
