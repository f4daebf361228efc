"""What Prometheus sees of a hub: what happened, and how it stands."""

from types import SimpleNamespace

import pytest

from eigenfail_services.hub.metrics import (
    CampaignLoad,
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


def test_what_has_not_happened_is_counted_as_0_times():
    metrics = Metrics()
    assert value(metrics, "results_total", verdict="alarm") == 0
    assert value(metrics, "learners_lost_total", kind="hung") == 0
