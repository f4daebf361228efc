"""Pages as they leave the server, before any script runs."""

import html
import re

import pytest
from msgspec.structs import replace

from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail_api.dashboard.rendering import STATIC
from eigenfail_workers.scenarios.cut_in import CutIn

HTML = {"Accept": "text/html"}


def test_an_empty_service(check_page):
    check_page("dashboard/overview/empty", "/")


def test_campaigns_are_listed_with_what_they_cost(
    *, look, check_page, http, fields, store, deliver, result, deliver_failed
):
    ended = Measures(1.3, None, 0.2, 30.0, final_drac_mps2=22.0)
    first, *_, last = (
        http.post("/api/v1/campaigns", json={**fields, "method": method}).json()["id"]
        for method in ("monte_carlo", "cem", "difs")
    )
    deliver(first, *(result(index) for index in range(9)), result(9, Outcome.COLLISION))
    store.campaigns.add_active(first, 3000.0)
    deliver_failed(last, 2, beside=(replace(result(0), measures=ended), result(1)))
    check_page("dashboard/overview/campaigns", "/")
    # 1.20 USD/h × 50 min for one failure; Wilson's interval of 1 in 10, turned over.
    assert "1.00 USD n = 1 95 %: [0.247, 5.60] USD" in look("/")


def test_a_campaign_without_failures_has_a_bound_never_a_blank(
    look, store, campaign, deliver, result
):
    deliver(campaign, *(result(index) for index in range(10)))
    store.campaigns.add_active(campaign, 3000.0)
    # At most 1 − 0.05^(1/10) = 0.2589 failures per episode: at least 1 USD ÷ 2.589.
    assert "≥ 0.386 USD n = 0 in 10 95 % lower bound" in look("/")


def test_a_campaign_shows_what_its_scenario_leaves_out(look, campaign, monkeypatch):
    assert "recording" not in look(f"/campaigns/{campaign}")
    for name in ("left_out", "notes"):
        monkeypatch.setattr(CutIn, name, (f"'{name}': It is uncertain.",), raising=False)
    said = look(f"/campaigns/{campaign}")
    assert "The scenario does not use all of its recording (2)" in said
    assert "'left_out': It is uncertain. 'notes': It is uncertain." in said


@pytest.mark.parametrize(
    ("state", "wishes"),
    [
        ((), ["pause", "cancel"]),
        (("running",), ["pause", "cancel"]),
        (("running", "pausing"), ["cancel"]),
        (("paused",), ["resume", "cancel"]),
        (("running", "done"), []),
    ],
)
def test_only_what_the_state_allows_is_offered(http, store, campaign, state, wishes):
    for each in state:
        store.campaigns.move(campaign, each)
    page = http.get(f"/campaigns/{campaign}").text
    offered = [w for w in ("pause", "resume", "cancel") if f"{campaign}/{w}" in page]
    assert offered == wishes


def test_a_campaign_without_results(check_page, campaign):
    check_page("dashboard/campaign/queued", f"/campaigns/{campaign}")


def test_a_long_list_of_failures_offers_more(http, fields, deliver, result):
    long = http.post("/api/v1/campaigns", json={**fields, "episodes": 30}).json()["id"]
    deliver(long, *(result(index, Outcome.COLLISION) for index in range(30)))
    page = http.get(f"/campaigns/{long}").text
    more = html.unescape(re.search(r'hx-get="([^"]*/failures[^"]*)"', page)[1])
    rest = http.get(more).text
    rows = re.compile(r'<th scope="row"><a href="/campaigns/\d+/episodes/(\d+)')
    assert sorted(map(int, rows.findall(page) + rows.findall(rest))) == [*range(30)]
    assert "<html" not in rest


def test_an_episode_that_crashed_has_its_scene(check_page, campaign, deliver, result):
    # Of the first release: a collision without a class.
    deliver(campaign, result(3, Outcome.COLLISION), result(4))
    check_page("dashboard/episode/collision", f"/campaigns/{campaign}/episodes/3")
    check_page("dashboard/episode/safe", f"/campaigns/{campaign}/episodes/4")


def test_an_episode_has_its_danger_and_how_it_was_driven(check_page, campaign, deliver, result):
    crash = Measures(
        0.0,
        severity=25.0,
        min_ttc_s=0.1,
        ttc_violated_s=1.5,
        drac_at_warning_mps2=6.5,
        collided_s=3.75,
        max_jerk_mps3=12.5,
        hard_brakings=2,
        clipped_steps=0,
    )
    deliver(campaign, replace(result(0, Outcome.COLLISION), measures=crash))
    check_page("dashboard/episode/planner_failure", f"/campaigns/{campaign}/episodes/0")


def test_a_campaign_counts_its_conflicts(look, check_page, campaign, deliver, result):
    crash = Measures(
        *(0.0, 25.0, 0.1, 9.0),
        ttc_violated_s=1.0,
        drac_violated_s=2.75,
        drac_at_warning_mps2=4.0,
        collided_s=3.0,
    )
    sudden = Measures(0.0, 25.0, collided_s=3.0)
    deliver(
        campaign,
        *(replace(result(i, Outcome.COLLISION), measures=crash) for i in (0, 1)),
        replace(result(2, Outcome.COLLISION), measures=sudden),
        replace(result(3), measures=Measures(0.5, min_ttc_s=1.2)),
        result(4),
    )
    check_page("dashboard/campaign/conflicts", f"/campaigns/{campaign}")
    text = look(f"/campaigns/{campaign}")
    assert "Lead time of MinTTC 2.00 s mean of 2" in text
    assert "Lead time of DRAC 0.250 s mean of 2" in text


def test_who_ended_too_early_to_tell_stands_beside_the_failures(
    check_page, http, campaign, deliver, result
):
    ended = Measures(1.3, None, 0.2, 30.0, final_drac_mps2=22.0)
    deliver(campaign, replace(result(0), measures=ended), result(1))
    address = f"/campaigns/{campaign}"
    check_page("dashboard/campaign/unresolved", address, "live")
    check_page("dashboard/measures/unresolved", f"{address}/measures")
    check_page("dashboard/episode/unresolved", f"{address}/episodes/0")
    check_page("dashboard/episodes/unresolved", f"{address}/episodes", "found")
    told = http.get(f"/api/v1/campaigns/{campaign}/summary").json()
    assert told["unresolved"] == {"count": 1, "horizon_s": 10.0}
    assert (told["failure_rate"]["k"], told["failure_rate"]["n"]) == (0, 2)


@pytest.fixture
def deliver_one(deliver, result, store):
    """Commits the result of the campaign's next episode."""

    def commit(campaign):
        deliver(campaign, result(store.campaigns.get(campaign).counts.completed))

    return commit


@pytest.fixture
def deliver_failed(deliver, failed):
    """Commits errored episodes of these indices, and other results beside them."""

    def commit(campaign, *indices, beside=()):
        deliver(campaign, *beside, *map(failed, indices))

    return commit


@pytest.mark.fault(
    "campaign whose every episode errors",
    group="plug-ins",
    outcome="The campaign is errored on every page, command and report, never done, and names the "
    "most frequent reason; the command exits with 3.",
)
def test_a_campaign_whose_every_episode_errored_is_errored_and_says_why(
    check_page, http, store, campaign, deliver_failed
):
    deliver_failed(campaign, *range(10))
    store.campaigns.move(campaign, CampaignState.DONE)
    pages = {
        "dashboard/overview/errored": "/",
        "dashboard/campaign/errored": f"/campaigns/{campaign}",
        "dashboard/episode/errored": f"/campaigns/{campaign}/episodes/3",
        "dashboard/comparison/errored": f"/comparison?campaign={campaign}",
    }
    for name, address in pages.items():
        check_page(name, address)
        assert "tone-good" not in http.get(address).text
    listed = f"/campaigns/{campaign}/episodes?filter=outcome%20%3D%20errored"
    assert f'href="{listed}"' in http.get(f"/campaigns/{campaign}").text
    check_page("dashboard/episodes/errored", listed, "found")


@pytest.mark.fault("campaign resumed by another release")
def test_a_campaign_of_two_releases_says_so_on_its_page(look, http, store, campaign, deliver_one):
    for version in ("1.0.0", "1.1.0"):
        store.campaigns.begin_part(campaign, {"eigenfail": version})
        deliver_one(campaign)
    words = "went on with other versions after 1 result: eigenfail 1.0.0 then, 1.1.0 now."
    assert words in look(f"/campaigns/{campaign}")
    told = http.get(f"/api/v1/campaigns/{campaign}").json()
    assert [part["results"] for part in told["parts"]] == [0, 1]


def test_a_share_of_errored_episodes_stands_beside_the_rate(
    check_page, http, campaign, deliver_failed, result
):
    deliver_failed(campaign, 2, 3, beside=(result(0, Outcome.COLLISION), result(4)))
    check_page("dashboard/campaign/partly_errored", f"/campaigns/{campaign}", "live")
    told = http.get(f"/api/v1/campaigns/{campaign}/summary").json()
    assert told["errored"] == {
        "count": 2,
        "kind": "planner",
        "reason": "It raised.",
        "times": 2,
        "first": 2,
    }
    assert told["failure_rate"]["n"] == 2


def test_suites_tell_errored_campaigns_from_those_that_are_done(
    http, store, fields, deliver_failed, result
):
    first, second = (
        http.post("/api/v1/campaigns", json={**fields, "name": f"pair: {name}"}).json()["id"]
        for name in ("a", "b")
    )
    deliver_failed(first, 0)
    deliver_failed(second, beside=(result(0),))
    for campaign in (first, second):
        store.campaigns.move(campaign, CampaignState.DONE)
    suites = http.get("/suites").text
    assert re.findall(r"badge tone-(good|bad)", suites) == ["good", "bad"]
    assert http.get("/suites/pair").text.count("badge tone-bad") == 1


def test_the_next_failure_is_one_click_away(http, campaign, deliver, result):
    deliver(campaign, result(1, Outcome.COLLISION), result(2), result(5, Outcome.COLLISION))
    page = http.get(f"/campaigns/{campaign}/episodes/1").text
    assert f'href="/campaigns/{campaign}/episodes/5"' in page
    last = http.get(f"/campaigns/{campaign}/episodes/5").text
    assert "Next failure" not in last
    assert "Previous failure (1)" in last


def test_the_worst_failure_is_first_once_a_campaign_has_ended(
    http, store, campaign, deliver, result
):
    severe = [
        replace(result(index, Outcome.COLLISION), measures=Measures(0.0, severity=float(index % 3)))
        for index in range(6)
    ]
    deliver(campaign, *severe)
    rows = re.compile(r'<th scope="row"><a href="/campaigns/\d+/episodes/(\d+)\?')
    assert rows.findall(http.get(f"/campaigns/{campaign}").text) == list("012345")
    store.campaigns.move(campaign, CampaignState.DONE)
    assert rows.findall(http.get(f"/campaigns/{campaign}").text) == list("524130")


def test_the_next_steps_are_what_the_failures_call_for(http, store, campaign, deliver, result):
    deliver(campaign, result(1, Outcome.COLLISION), result(2))
    assert "Next steps" not in http.get(f"/campaigns/{campaign}").text
    store.campaigns.move(campaign, CampaignState.DONE)
    page = http.get(f"/campaigns/{campaign}").text
    shrink = f"/api/v1/campaigns/{campaign}/episodes/1/shrink"
    assert f'action="/api/v1/campaigns/{campaign}/analyses"' in page
    assert f'action="{shrink}"' in page
    made = http.post(shrink, json={}).json()
    assert made["spec"]["settings"] == {"campaign": campaign, "episode": 1}
    assert http.post(shrink.replace("episodes/1", "episodes/2"), json={}).status_code == 422


def test_an_analysis_waits_fails_or_shows_its_modes(check_page, store, campaign, finished):
    done = finished(2)
    waiting = store.analyses.create(campaign, store.analyses.get(done).settings).id
    check_page("dashboard/analysis/queued", f"/analyses/{waiting}")
    store.analyses.fail(waiting, "There are no failures to analyse.")
    check_page("dashboard/analysis/failed", f"/analyses/{waiting}")
    check_page("dashboard/analysis/done", f"/analyses/{done}")


@pytest.mark.parametrize(
    ("name", "address", "status"),
    [
        ("no_campaign", "/campaigns/7", 404),
        ("no_id", "/campaigns/seven", 422),
        ("no_analysis", "/analyses/7", 404),
        ("no_page", "/nowhere", 404),
        ("no_query", "/?bfore=3", 422),
    ],
)
def test_problems_are_pages_for_browsers(check_page, name, address, status):
    check_page(f"dashboard/problem/{name}", address, status=status)


def test_problems_stay_problems_for_programs(http, problem):
    problem(http.get("/campaigns/7"), 404)
    problem(http.get("/api/v1/campaigns/7", headers={"accept": "text/html,*/*;q=0.8"}), 404)
    problem(http.get("/api/v1/campaigns/7", headers=HTML), 406)


def test_a_fault_of_our_own_is_a_page_too(http, look, store, monkeypatch):
    def fail(*_):
        raise RuntimeError("secret")

    monkeypatch.setattr(store.campaigns, "page", fail)
    text = look("/", 500)
    assert "Internal error" in text
    assert "secret" not in text
    policy = http.get("/", headers=HTML).headers["content-security-policy"]
    assert policy == http.get("/healthz").headers["content-security-policy"]


def test_unchanged_files_are_asked_after_but_not_sent_again(http):
    first = http.get("/static/js/main.js")
    assert first.content == (STATIC / "js/main.js").read_bytes()
    assert "javascript" in first.headers["content-type"]
    assert first.headers["cache-control"] == "no-cache"
    again = http.get("/static/js/main.js", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_nothing_outside_of_the_static_folder_is_sent(http):
    assert http.get("/static/%2e%2e/pages.py").status_code == 404
    assert http.get("/static/js/").status_code == 404


def test_an_episode_of_a_campaign_that_varies_shows_what_it_drew(
    check_page, http, fields, deliver, result
):
    varied = fields | {"scenario_parameters": {"distance_m": {"choice": [61.25]}}}
    campaign = http.post("/api/v1/campaigns", json=varied).json()["id"]
    deliver(campaign, result(3, Outcome.COLLISION))
    # The time step is the scenario's: the steps of the page tell that it could be staged.
    check_page("dashboard/episode/varied", f"/campaigns/{campaign}/episodes/3")
