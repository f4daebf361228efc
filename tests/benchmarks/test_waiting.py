"""The share of a campaign in which its worker waits, as `make bench` measures it."""

from types import SimpleNamespace

import pytest
from benchmarks.speed import waiting


def test_episodes_of_the_first_commit_ran_before_the_time_that_is_measured():
    """From 1 s to 3 s, of which the last two episodes ran for 0.5 s each."""
    times = ((3_000, 0.5), (1_000, 0.3), (2_000, 0.5), (1_000, 0.3))
    rows = [SimpleNamespace(finished_ms=ms, wall_s=wall_s) for ms, wall_s in times]
    assert waiting.share_waiting(rows) == pytest.approx(0.5)
