"""The first page: what is filtered, what is pooled, who is at work."""

import msgspec
import pytest

from eigenfail.values.episode import Outcome
from eigenfail.values.operations import Arrival
from eigenfail_api.dashboard.campaign_page import find_origin


@pytest.fixture
def make(http, fields):
    """Makes a campaign; its id."""
    return lambda **changes: http.post("/api/v1/campaigns", json=fields | changes).json()["id"]


@pytest.fixture
def names(http):
    """The campaigns of a page, by the ids of their rows."""

    def read(address):
        text = http.get(address).text
        return [int(part.split('"')[0]) for part in text.split('id="campaign-')[1:]]

    return read


def test_campaigns_are_filtered_in_the_address(store, make, names, check_page):
    one, two, three = make(name="Cut-in"), make(name="merging"), make(name="cut-in again")
    store.campaigns.move(two, "running")
    store.campaigns.move(three, "running")
    assert names("/") == [three, two, one]
    assert names("/?state=running") == [three, two]
    assert names("/?search=CUT-in") == [three, one]
    assert names("/?state=running&method=monte_carlo&search=cut") == [three]
    assert names("/?state=&method=&search=") == [three, two, one]
    assert names("/?method=ast") == []
    check_page("dashboard/overview/no_match", "/?method=ast")


def test_filters_stay_from_page_to_page(http, make, names):
    ids = [make(name=f"wanted {n}") for n in range(51)]
    make(name="other")
    text = http.get("/?search=wanted").text
    assert names("/?search=wanted") == ids[:0:-1]
    older = f"/?search=wanted&amp;before={ids[1]}"
    assert f'href="{older}"' in text
    assert names(older.replace("&amp;", "&")) == ids[:1]


def test_a_method_costs_what_all_of_its_campaigns_cost(store, make, deliver, result, look):
    for seed in (1, 2):
        campaign = make(seed=seed)
        deliver(campaign, *(result(index) for index in range(5)))
        store.campaigns.add_active(campaign, 1500.0)
    # 1.00 USD for ten episodes: at most 1 − 0.05^(1/10) = 0.2589 failures in each.
    assert "monte_carlo ≥ 0.386 95 % lower bound 0 10 ≤ 25.9 % (0 of 10) 1.00 2" in look("/")


def test_who_brought_results_lately_is_at_work(campaign, deliver, result, look):
    assert "Workers now 0" in look("/")
    deliver(campaign, *(result(index) for index in range(6)))
    assert "Workers now 1" in look("/")
    assert "Episodes/s now 0.100" in look("/")


def test_work_without_workers_is_told_until_one_comes(store, campaign, check_page):
    check_page("dashboard/overview/without_workers", "/", "campaigns")
    store.roster.arrived([Arrival(worker="w1", host="here", pid=7)])
    check_page("dashboard/overview/idle_worker", "/", "campaigns")


def test_where_nobody_works_the_last_word_on_workers_that_are_to_come_is_told(
    store, campaign, check_page, http
):
    store.events.append("workers.asked", "4 workers asked of Ray, none placed yet.")
    store.events.append("campaign.progress", "0 of 10 episodes.", campaign)
    check_page("dashboard/overview/workers_to_come", "/", "campaigns")
    check_page("dashboard/campaign/workers_to_come", f"/campaigns/{campaign}", "live")
    told = http.get("/api/v1/workers/staffing").json()
    assert (told["workers"], told["said"]) == (0, "4 workers asked of Ray, none placed yet.")
    assert told["said_ms"] > 0
    store.roster.arrived([Arrival(worker="w1", host="here", pid=7)])
    check_page("dashboard/overview/idle_worker", "/", "campaigns")
    assert http.get("/api/v1/workers/staffing").json()["workers"] == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"method": "ast"}, (20, "to use all of them, launch it with parallel = 21.")),
        (
            {"method": "cem", "settings": {"batch": 12}},
            (12, "run several seeds side by side: eigenfail run --seeds N."),
        ),
        ({"method": "monte_carlo"}, None),
        ({"method": "ast", "parallel": 21}, None),
    ],
)
def test_the_page_of_a_campaign_says_when_it_leaves_workers_idle(store, make, look, changes, words):
    number = make(name="narrow", simulator="highway", scenario="cut_in", episodes=500, **changes)
    address = f"/campaigns/{number}"
    store.roster.arrived([Arrival(worker=f"w{n}", host="here", pid=n + 1) for n in range(21)])
    assert "Workers are idle" not in look(address)
    store.campaigns.move(number, "running")
    told = look(address)
    assert ("Workers are idle" in told) == (words is not None)
    if words is not None:
        count, advice = words
        said = f"runs at most {count} episodes at a time, and 21 workers are connected; {advice}"
        assert f"Workers are idle: this campaign {said}" in told
        store.campaigns.move(make(name="another", episodes=100), "running")
        assert "Workers are idle" not in look(address)


@pytest.fixture
def replay(http, campaign, deliver, result):
    """A replay of an episode of a campaign, and that campaign."""
    deliver(campaign, result(3, Outcome.COLLISION))
    return http.post(f"/api/v1/campaigns/{campaign}/episodes/3/replay").json()["id"], campaign


def test_replays_are_folded_away_and_one_click_from_the_searches(replay, names, check_page):
    again, searched = replay
    assert names("/") == [searched]
    assert names("/?state=running&search=first") == [searched]
    assert names("/?method=replay") == [again]
    check_page("dashboard/overview/replay_folded", "/")
    check_page("dashboard/overview/replays", "/?method=replay")


def test_a_search_that_means_replays_leads_to_them(replay, names, http):
    text = http.get("/?search=replay+of&before=99").text
    address = text.split('Not listed: <a href="')[1].split('"')[0].replace("&amp;", "&")
    assert "matches among 1 replay<" in text
    assert names(address) == [replay[0]]


def test_a_campaign_leads_to_its_replays_and_they_lead_back(replay, names, http):
    again, searched = replay
    text = http.get(f"/campaigns/{searched}").text
    address = f"/?method=replay&amp;search=replay+of+{searched}%2F"
    assert f'href="{address}"' in text
    assert names(address.replace("&amp;", "&")) == [again]
    assert "It replays" not in text
    back = http.get(f"/campaigns/{again}").text
    assert f'It replays <a href="/campaigns/{searched}">campaign {searched}</a>.' in back


def test_a_proof_leads_back_to_its_analysis(store, campaign):
    spec = store.campaigns.get(campaign).spec
    assert find_origin(spec) is None
    proof = msgspec.structs.replace(spec, method="replay", settings={"analysis": 7})
    assert find_origin(proof) == ("analysis 7", "/analyses/7")


def test_an_analysis_that_is_done_leads_to_its_replays(campaign, finished, http):
    finished(2)
    text = http.get(f"/campaigns/{campaign}").text
    assert 'href="/analyses/1#proof"' in text


BRIDGE = "No connected worker has a bridge: start one with `eigenfail worker`."


def test_what_a_campaign_lacks_is_told_until_it_goes_on(store, make, check_page, http):
    one, other = make(simulator="point_mass"), make(seed=2)
    store.roster.arrived([Arrival(worker="w1", host="here", pid=7)])
    for campaign in (one, other):
        store.campaigns.move(campaign, "running")
    store.events.append("workers.lacking", BRIDGE, one)
    check_page("dashboard/overview/lacking_bridge", "/", "campaigns")
    assert notes(http, one) == 1
    assert notes(http, other) == 0
    (event,) = http.get("/api/v1/workers/staffing").json()["stranded"]
    assert (event["campaign"], event["message"]) == (one, BRIDGE)


@pytest.mark.parametrize("kind", ["workers.met", "campaign.progress", "campaign.state"])
def test_what_a_campaign_lacked_is_told_no_more(store, make, look, http, kind):
    campaign = make()
    store.campaigns.move(campaign, "running")
    store.events.append("workers.lacking", BRIDGE, campaign)
    store.events.append(kind, "It goes on.", campaign)
    assert BRIDGE not in look("/")
    assert notes(http, campaign) == 0
    assert http.get("/api/v1/workers/staffing").json()["stranded"] == []


def test_of_a_campaign_that_is_paused_nothing_is_lacking(store, make, look, http):
    campaign = make()
    for state in ("running", "pausing"):
        store.campaigns.move(campaign, state)
    store.events.append("workers.lacking", BRIDGE, campaign)
    assert BRIDGE not in look("/")
    assert notes(http, campaign) == 0


def test_campaigns_that_lack_the_same_share_a_note(store, make, look):
    for campaign in (make(), make(seed=2)):
        store.campaigns.move(campaign, "running")
        store.events.append("workers.lacking", BRIDGE, campaign)
    assert look("/").count(BRIDGE) == 1


def notes(http, campaign):
    """How often a campaign's page says, beside its events, what is lacking."""
    text = http.get(f"/campaigns/{campaign}").text
    return text.count(f'role="status"><a href="/campaigns/{campaign}">')
