"""Whole campaigns on toy problems, in this process."""

import pytest
from odd_problems import run_search


@pytest.fixture
def search():
    """Run a campaign of a method on a problem: the learner as it ends, and all results."""
    return run_search
