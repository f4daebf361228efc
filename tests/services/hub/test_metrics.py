"""What Prometheus sees of a hub: what happened, and how it stands."""

from types import SimpleNamespace

import pytest
from prometheus_client import CollectorRegistry, Histogram

from eigenfail_services.hub.metrics import (
    CampaignLoad,
    DurationHistogram,
    HubStatus,
    Metrics,
    Work,
    observe_duration,
    summarize_status,
)


def value(metrics, name, **labels):
    return metrics.registry.get_sample_value(f"eigenfail_{name}", labels)


def seat(*held):
    return SimpleNamespace(held=dict.fromkeys(held))


def campaign(episodes, learner_s=0.0):
    return SimpleNamespace(work=lambda: Work(episodes), learner_s=learner_s)


def test_what_waits_is_what_is_open_and_with_nobody():
    seats = [seat((1, 0), (1, 1)), seat((2, 0)), seat()]
    stands = summarize_status({1: campaign(10, 0.5), 2: campaign(1)}, seats)
    assert stands == HubStatus({1: CampaignLoad(8, 2, 0.5), 2: CampaignLoad(0, 1)}, 3)


def test_a_result_that_waits_for_its_commit_makes_no_negative_queue():
    assert summarize_status({1: campaign(0)}, [seat((1, 0))]).campaigns == {1: CampaignLoad(0, 1)}


def test_what_stands_is_scraped_for_those_campaigns_alone_that_run():
    metrics = Metrics()
    metrics.status = HubStatus({7: CampaignLoad(3, 2, 1.5)}, 4)
    assert value(metrics, "workers") == 4
    assert value(metrics, "episodes_waiting", campaign="7") == 3
    assert value(metrics, "episodes_leased", campaign="7") == 2
    assert value(metrics, "learner_busy_seconds", campaign="7") == 1.5
    metrics.status = HubStatus()
    assert value(metrics, "episodes_waiting", campaign="7") is None


def test_a_block_that_breaks_off_is_not_timed():
    metrics = Metrics()
    with observe_duration(metrics.commit_s):
        pass
    with pytest.raises(ZeroDivisionError), observe_duration(metrics.commit_s):
        raise ZeroDivisionError
    assert value(metrics, "commit_seconds_count") == 1


def test_durations_are_counted_as_prometheus_itself_counts_them():
    registry = CollectorRegistry()
    bounds_s = (0.01, 0.5, 2.0)
    one_by_one = Histogram("single", "", buckets=bounds_s, registry=registry)
    together = DurationHistogram("together", "", bounds_s)
    registry.register(together)
    for durations_s in ([], [0.0, 0.01, 0.011, 0.5], [2.0, 2.1, 1e6, 0.3]):
        together.observe(durations_s)
        for duration_s in durations_s:
            one_by_one.observe(duration_s)
        for bound in ("0.01", "0.5", "2.0", "+Inf"):
            counts = [
                registry.get_sample_value(f"{name}_bucket", {"le": bound})
                for name in ("single", "together")
            ]
            assert counts[0] == counts[1], bound
        for part in ("count", "sum"):
            sums = [registry.get_sample_value(f"{name}_{part}") for name in ("single", "together")]
            assert sums[0] == pytest.approx(sums[1]), part


def test_what_has_not_happened_is_counted_as_0_times():
    metrics = Metrics()
    assert value(metrics, "results_total", verdict="alarm") == 0
    assert value(metrics, "learners_lost_total", kind="hung") == 0
