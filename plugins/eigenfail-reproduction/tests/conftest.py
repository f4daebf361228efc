"""What the tests of the plug-in share: a service that costs nothing, and made-up summaries."""

from functools import partial
from importlib import import_module
from pathlib import Path

import pytest
from working_service import WorkingService, run_command

from eigenfail.intervals import find_interval
from eigenfail.values.campaign import Counts
from eigenfail.values.estimates import Cost, Rate
from eigenfail.values.safety import FailurePoint, Safety, Scatter, SeverityRisk, Violations
from eigenfail.values.summary import Conflicts, Summary
from eigenfail_reproduction.programme import build_suite

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture
def import_benchmark(monkeypatch):
    """Imports a benchmark of the plug-in by its name."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
    return import_module


@pytest.fixture
def eigenfail(store, monkeypatch):
    """Runs a command against the service; its result has exit_code, stdout and stderr."""
    monkeypatch.setattr("eigenfail.client.link.sleep", lambda seconds: None)
    return partial(run_command, WorkingService(store))


def make_summary(number, name, failures, completed=300, *, per_step=-2.0, severity=100.0):
    """A campaign with so many failures."""
    share = failures / completed
    sampled = name.startswith("monte_carlo")
    interval = find_interval(failures, completed) if sampled else None
    return Summary(
        campaign=number,
        name=name,
        method="ast",
        counts=Counts(planned=completed, completed=completed, failures=failures),
        failure_rate=Rate(share, failures, completed, interval, sampled),
        mean_log_probability=per_step * 80 if failures else None,
        log_probability_per_step=per_step if failures else None,
        mean_severity=severity if failures else None,
        episodes_per_s=20.0,
        cost=Cost(0.01, 0.01, 0.001 if failures else None, None, 0.0001),
    )


@pytest.fixture
def summary():
    return make_summary


@pytest.fixture
def summaries():
    """All members, each with 150 failures of 300 but for Monte Carlo of the planner."""
    found = {
        member.name: make_summary(number, member.name, 150)
        for number, member in enumerate(build_suite("full").members, start=1)
    }
    found["monte_carlo rulebook"] = make_summary(1, "monte_carlo rulebook", 0, 2000)
    return found


def make_safety(summary, wide=0.01):
    """The failures of a summary one by one, alternately a little above and below its means."""
    points = tuple(
        FailurePoint(
            index,
            summary.log_probability_per_step + wide * (-1) ** index,
            summary.mean_severity + wide * (-1) ** index,
            None,
        )
        for index in range(summary.counts.failures)
    )
    nothing = Violations(threshold=1.5, beyond=None, n=0, median=None, worst=None)
    return Safety(
        campaign=summary.campaign,
        name=summary.name,
        method=summary.method,
        completed=summary.counts.completed,
        failures=summary.failure_rate,
        collisions=summary.failure_rate,
        near_misses=None,
        conflicts=Conflicts(),
        ttc=nothing,
        drac=nothing,
        severity=SeverityRisk(level=0.95, n=len(points), beyond=0.0),
        scatter=Scatter(points, len(points)),
    )


@pytest.fixture
def safety():
    return make_safety
