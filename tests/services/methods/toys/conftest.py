"""Whole campaigns on toy problems, in this process."""

import sys
from pathlib import Path

import pytest
from odd_problems import run_search

sys.path.append(str(Path(__file__).parent))


@pytest.fixture
def search():
    """Run a campaign of a method on a problem: the learner as it ends, and all results."""
    return run_search
