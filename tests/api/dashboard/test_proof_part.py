"""Proof by replay on the page of an analysis."""

import pytest

from eigenfail.values import Outcome, Rate, Reproduction
from eigenfail_api.dashboard.proof import NOT_TRIED, describe_reproduction
from eigenfail_services.statistics.intervals import rate

HTML = {"Accept": "text/html"}
BUTTON = "/proof"


@pytest.fixture
def prove(http):
    """Asks for a proof; the campaigns that replay."""

    def ask(analysis, **wanted):
        asked = http.post(f"/api/v1/analyses/{analysis}/proof", json=wanted)
        assert asked.status_code == 202
        return [scenario["campaign"] for scenario in asked.json()["scenarios"]]

    return ask


@pytest.fixture
def pages(http, look, finished):
    """An analysis of two modes; its page, and the text of that."""
    analysis = finished(2)
    address = f"/analyses/{analysis}"
    return analysis, lambda: http.get(address, headers=HTML).text, lambda: look(address)


@pytest.fixture
def replayed(deliver, result):
    """Delivers the four episodes of a replay."""

    def go(campaign, crashed):
        outcomes = [Outcome.COLLISION if index in crashed else Outcome.SAFE for index in range(4)]
        deliver(campaign, *(result(index, outcomes[index]) for index in range(4)))

    return go


def test_replays_are_counted_without_an_interval():
    found = Reproduction(rate(3, 4), 0.0)
    assert isinstance(found.rate, Rate)
    figure = describe_reproduction(found)
    assert (figure.value, figure.notes) == ("3 of 4", ())
    (nearest,) = describe_reproduction(Reproduction(rate(0, 2), 1.25)).notes
    assert nearest == "smallest robustness 1.25\u00a0m"
    assert describe_reproduction(Reproduction()) == NOT_TRIED


def test_nothing_is_proven_before_somebody_asks(http, look, finished):
    analysis = finished(2)
    assert "No proof yet." in look(f"/analyses/{analysis}")
    html = http.get(f"/analyses/{analysis}", headers=HTML).text
    assert f'action="/api/v1/analyses/{analysis}{BUTTON}"' in html
    assert 'data-open="false"' in html


def test_a_proof_is_followed_until_its_last_replay(store, pages, prove, replayed):
    analysis, page, text = pages
    same, near = prove(analysis, variations=[{}, {"distance_m": 61.0}])
    assert 'data-open="true"' in page()
    assert f"/analyses/{analysis}{BUTTON}" not in page()
    # Eigenfailures of both modes come first, then their medoids.
    replayed(same, crashed=(0, 2))
    told = text()
    assert "4 / 8 replays" in told
    assert "Eigenfailures, same scenario 1 of 2 Eigenfailures" in told
    assert "distance_m = 61.0" in told
    assert "Eigenfailure reproduced 0 of 1 smallest robustness 3.50 m" in told
    assert "the same 1 eigenfailure ◆ collision 0 −" in told
    replayed(near, crashed=())
    for campaign in (same, near):
        store.campaigns.move(campaign, "done")
    assert "8 / 8 replays, all ended" in text()
    assert 'data-open="false"' in page()


def test_a_replay_that_came_to_nothing_may_be_asked_for_again(http, store, look, finished, prove):
    analysis = finished(1)
    (only,) = prove(analysis, variations=[{}])
    store.campaigns.move(only, "cancelled")
    assert "Prove again" in look(f"/analyses/{analysis}")
    assert f'{BUTTON}"' in http.get(f"/analyses/{analysis}", headers=HTML).text


def test_a_replay_that_could_not_be_run_was_not_tried(pages, prove, deliver, failed, result):
    analysis, _, text = pages
    (only,) = prove(analysis, variations=[{}])
    deliver(only, failed(0), failed(1), result(2, Outcome.COLLISION), result(3))
    told = text()
    assert "4 / 4 replays" in told
    assert "Eigenfailures, same scenario – no replay completed" in told
    assert "Medoids 1 of 2" in told


def test_replays_that_all_errored_are_not_shown_as_done(pages, store, prove, deliver, failed):
    _, page, _ = pages
    (only,) = prove(pages[0], variations=[{}])
    deliver(only, *(failed(index) for index in range(4)))
    store.campaigns.move(only, "done")
    link = f'<a href="/campaigns/{only}">campaign {only}</a>'
    cell = page().partition(link)[2].partition("</td>")[0]
    assert "errored" in cell
    assert "tone-bad" in cell
    assert "done" not in cell
