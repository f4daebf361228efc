"""What a run of the tests did not prove: every test that was skipped is told at the end.

With EIGENFAIL_REQUIRE_PROOFS=1 a skip is a failure.
"""

import os
from collections.abc import Generator

import pytest

VARIABLE = "EIGENFAIL_REQUIRE_PROOFS"
HEADING = "NOT PROVED HERE"


def reason(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Why it was skipped, without the place where that was decided."""
    told = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longreprtext
    return told.removeprefix("Skipped: ")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    skipped = report.skipped and not hasattr(report, "wasxfail")
    if skipped and os.environ.get(VARIABLE) == "1":
        report.longrepr = f"{HEADING}, and {VARIABLE} is set: {reason(report)}"
        report.outcome = "failed"
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A module that is skipped as a whole is not proved either."""
    report = yield
    if report.skipped and os.environ.get(VARIABLE) == "1":
        report.longrepr = f"{HEADING}, and {VARIABLE} is set: {reason(report)}"
        report.outcome = "failed"
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = terminalreporter.getreports("skipped")
    if not skipped:
        return
    terminalreporter.section(f"{HEADING}: {len(skipped)} skipped")
    for report in sorted(skipped, key=lambda each: each.nodeid):
        terminalreporter.line(f"{report.nodeid}: {reason(report)}")
