"""Episodes whose noise was taken away: what the API says of them, and of what took it."""

import pytest

from eigenfail.client import Client
from eigenfail.client.link import read_refusal
from eigenfail.errors import NoisePruned
from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import Outcome
from eigenfail.values.operations import Retention, Weight

URL = "/api/v1/campaigns"


@pytest.fixture
def pruned(store, campaign, deliver, result):
    """A campaign that is done, of which episodes 1 and 3 have lost their noise."""
    deliver(campaign, *(result(i) for i in range(4)), result(5, Outcome.COLLISION))
    for state in (CampaignState.CANCELLING, CampaignState.CANCELLED):
        store.campaigns.move(campaign, state)
    assert store.retention.prune(campaign, Retention(keep_every=2), "somebody")
    return campaign


@pytest.mark.parametrize("more", ["", "/explanation", "/steps"])
def test_what_needs_the_noise_is_gone_with_the_way_out(http, pruned, problem, more):
    told = problem(http.get(f"{URL}/{pruned}/episodes/1{more}"), 410)
    assert told["type"] == "urn:eigenfail:noise-pruned"
    assert f"The noise of episode {pruned}/1 was pruned on 20" in told["detail"]
    assert f"eigenfail episode replay {pruned}/1" in told["remedy"]
    assert isinstance(read_refusal(http.get(f"{URL}/{pruned}/episodes/1")), NoisePruned)


def test_a_replay_of_it_is_refused_alike(http, store, pruned, problem):
    before = len(store.campaigns.page(10).items)
    problem(http.post(f"{URL}/{pruned}/episodes/1/replay", json={}), 410)
    assert len(store.campaigns.page(10).items) == before


def test_its_row_is_listed_and_says_so(http, pruned):
    rows = http.get(f"{URL}/{pruned}/episodes").json()["items"]
    assert [row["index"] for row in rows if row["noise_pruned_ms"]] == [1, 3]
    assert [row["robustness_m"] for row in rows if row["outcome"] == "safe"] != []
    assert http.get(f"{URL}/{pruned}/episodes/2").status_code == 200
    assert http.get(f"{URL}/{pruned}/episodes/5").status_code == 200


def test_what_was_taken_is_told(http, pruned, problem):
    (record,) = http.get(f"{URL}/{pruned}/prunings").json()["items"]
    assert record["who"] == "somebody"
    assert record["retention"] == {"keep_every": 2, "source": "prior"}
    assert record["weight"]["episodes"] == 2
    problem(http.get(f"{URL}/99/prunings"), 404)


def test_a_campaign_that_lost_nothing_says_so(http, campaign):
    assert http.get(f"{URL}/{campaign}/prunings").json() == {"items": [], "next": None}


def test_the_client_tells_it_too(http, pruned):
    with Client("http://127.0.0.1:8440", http._transport) as client:
        (record,) = client.campaigns.prunings(pruned)
        assert record.weight == Weight(2, 0, record.weight.bytes)
        with pytest.raises(NoisePruned, match="was pruned on"):
            client.episodes.get(pruned, 1)


@pytest.mark.parametrize("page", ["", "/clip"])
def test_its_page_says_so(http, pruned, page):
    shown = http.get(f"/campaigns/{pruned}/episodes/1{page}", headers={"accept": "text/html"})
    assert shown.status_code == 410
    assert f"The noise of episode {pruned}/1 was pruned" in shown.text
    assert f"eigenfail episode replay {pruned}/1" in shown.text


@pytest.mark.parametrize("page", ["", "/episodes"])
def test_pages_of_its_campaign_are_as_before(http, pruned, page):
    assert http.get(f"/campaigns/{pruned}{page}").status_code == 200
