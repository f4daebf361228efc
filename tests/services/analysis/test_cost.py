"""The cost of a failure: the paper's table, its bounds, and what it must never be."""

import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values.estimates import Cost, Rate
from eigenfail_services.analysis.campaign_figures import price_failures
from eigenfail_services.statistics.intervals import rate


def seconds(clock: str) -> float:
    hours, minutes, rest = (int(part) for part in clock.split(":"))
    return 3600.0 * hours + 60.0 * minutes + rest


def price(active_s: float, instances: int, usd_per_hour: float, failures: Rate | None) -> Cost:
    hours = instances * active_s / 3600.0
    return price_failures(usd_per_hour * hours, hours, failures)


@pytest.mark.parametrize(
    ("run_time", "completed", "failures", "usd"),
    [
        ("08:55:50", 1000, 877, 0.012),  # AST, training
        ("12:57:11", 1000, 24, 0.648),  # DiFS, training
        ("05:32:08", 300, 284, 0.023),  # AST, evaluation
        ("03:53:10", 300, 9, 0.518),  # DiFS, evaluation
    ],
)
def test_it_is_the_paper_s(run_time: str, completed: int, failures: int, usd: float) -> None:
    found = price(seconds(run_time), 1, 1.20, rate(failures, completed))
    assert found.per_failure_usd is not None
    assert round(found.per_failure_usd, 3) == usd


def test_monte_carlo_without_a_failure_cost_at_least_10_5_usd_for_one() -> None:
    found = price(seconds("26:14:29"), 1, 1.20, rate(0, 2000))
    assert found.at_least_usd == pytest.approx(10.5, abs=0.05)
    assert found.per_failure_usd is None
    assert found.interval_usd is None


def test_nine_of_300_by_hand() -> None:
    found = price(3600.0, 2, 3.0, rate(9, 300))
    assert (found.instance_hours, found.total_usd) == (2.0, 6.0)
    assert found.per_failure_usd == pytest.approx(6.0 / 9.0)
    # 9 of 300 lies between 1.5862 % and 5.6022 %: 4.7586 to 16.8066 failures.
    assert found.interval_usd.low == pytest.approx(6.0 / 16.8066, rel=1e-4)
    assert found.interval_usd.high == pytest.approx(6.0 / 4.7586, rel=1e-4)


def test_before_the_first_episode_only_the_bill_is_known() -> None:
    found = price(1800.0, 4, 1.5, None)
    assert found.total_usd == 3.0
    assert found.per_failure_usd is found.interval_usd is found.at_least_usd is None


def test_what_is_free_costs_nothing() -> None:
    found = price(1800.0, 4, 0.0, rate(2, 10))
    assert found.total_usd == found.per_failure_usd == found.at_least_usd == 0.0


@st.composite
def campaigns(draw: st.DrawFn) -> tuple[float, int, float, Rate]:
    completed = draw(st.integers(1, 10_000_000))
    return (
        draw(st.floats(1e-3, 1e9)),
        draw(st.integers(1, 100_000)),
        draw(st.floats(1e-3, 100_000.0)),
        rate(draw(st.integers(0, completed)), completed),
    )


@given(campaigns())
def test_a_completed_episode_gives_a_finite_lower_bound(
    campaign: tuple[float, int, float, Rate],
) -> None:
    found = price(*campaign)
    assert 0.0 < found.at_least_usd < math.inf
    assert (found.per_failure_usd is None) == (found.interval_usd is None) == (campaign[3].k == 0)


@given(campaigns().filter(lambda campaign: campaign[3].k > 0))
def test_the_interval_holds_the_cost(campaign: tuple[float, int, float, Rate]) -> None:
    found = price(*campaign)
    assert found.per_failure_usd is not None
    assert found.interval_usd.low == found.at_least_usd
    slack = 1.0 + 1e-12
    assert found.interval_usd.low <= found.per_failure_usd * slack
    assert found.per_failure_usd <= found.interval_usd.high * slack
    assert found.interval_usd.high < math.inf


@pytest.mark.service
def test_prices_and_summaries_do_without_the_machinery_of_the_analysis() -> None:
    modules = "eigenfail_services.analysis.campaign_figures, eigenfail_services.campaigns.summary"
    light = f"import {modules}, sys; sys.exit('sklearn' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", light], check=False).returncode == 0
