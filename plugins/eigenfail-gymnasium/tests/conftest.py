"""An environment with a known region of failures, for every test."""

import sys
from pathlib import Path

import gymnasium
import pytest

sys.path.append(str(Path(__file__).parent))

from approach_environment import ID, MODULE, SOURCE, Approach


@pytest.fixture(autouse=True)
def approach(monkeypatch, tmp_path):
    """Register the environment, and list a module with policies for it in the working folder."""
    if ID not in gymnasium.registry:
        gymnasium.register(ID, Approach, max_episode_steps=8)
    (tmp_path / f"{MODULE}.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, MODULE, raising=False)
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", MODULE)
