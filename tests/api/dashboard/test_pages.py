"""Pages as they leave the server, before any script runs."""

import re

import pytest
from msgspec.structs import replace

from eigenfail.values import CampaignState, Measures, Outcome

HTML = {"Accept": "text/html"}


def test_an_empty_service_says_what_to_do_first(look):
    assert "eigenfail run examples/ast.toml" in look("/")


def test_a_campaign_is_listed_with_what_it_cost(look, store, campaign, deliver, result):
    deliver(campaign, *(result(index) for index in range(9)), result(9, Outcome.COLLISION))
    store.campaigns.add_active(campaign, 3000.0)
    text = look("/")
    assert "first idm in cut_in monte_carlo" in text
    assert "1 of 10 10.0 % [1.78, 40.5]" in text
    # 1.20 USD/h × 50 min for one failure; Wilson's interval of 1 in 10, turned over.
    assert "1.00 USD n = 1 95 %: [0.247, 5.60] USD" in text


def test_a_campaign_without_failures_has_a_bound_never_a_blank(
    look, store, campaign, deliver, result
):
    deliver(campaign, *(result(index) for index in range(10)))
    store.campaigns.add_active(campaign, 3000.0)
    # At most 1 − 0.05^(1/10) = 0.2589 failures per episode: at least 1 USD ÷ 2.589.
    assert "≥ 0.386 USD n = 0 in 10 95 % lower bound" in look("/")


def test_older_campaigns_are_behind_a_link(http, look, fields):
    ids = [http.post("/api/v1/campaigns", json=fields).json()["id"] for _ in range(51)]
    assert f'href="/?before={ids[1]}"' in http.get("/", headers=HTML).text
    assert "1 0 running" in look(f"/?before={ids[1]}")
    assert "No older campaigns" in look(f"/?before={ids[0]}")


def test_what_users_write_is_text_not_markup(http, fields):
    http.post("/api/v1/campaigns", json={**fields, "name": "<script>alert(1)</script>'\""})
    page = http.get("/", headers=HTML).text
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page


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
    page = http.get(f"/campaigns/{campaign}", headers=HTML).text
    offered = [w for w in ("pause", "resume", "cancel") if f"{campaign}/{w}" in page]
    assert offered == wishes


def test_a_campaign_without_results_says_so(look, campaign):
    text = look(f"/campaigns/{campaign}")
    assert "No episode has ended yet" in text
    assert "No failure yet" in text


def test_failures_come_page_by_page(http, look, campaign, deliver, result):
    deliver(campaign, *(result(index, Outcome.COLLISION) for index in range(10)))
    first = http.get(f"/campaigns/{campaign}", headers=HTML).text
    assert first.count(f'href="/campaigns/{campaign}/episodes/') == 10
    rest = http.get(f"/campaigns/{campaign}/failures?after=6", headers=HTML).text
    links = [f'href="/campaigns/{campaign}/episodes/{index}"' in rest for index in range(10)]
    assert links == [False] * 7 + [True] * 3
    assert "<html" not in rest


def test_a_long_list_of_failures_offers_more(http, fields, deliver, result):
    long = http.post("/api/v1/campaigns", json={**fields, "episodes": 30}).json()["id"]
    deliver(long, *(result(index, Outcome.COLLISION) for index in range(30)))
    assert f"/campaigns/{long}/failures?after=24" in http.get(f"/campaigns/{long}").text


def test_an_episode_that_crashed_shows_its_scene(look, campaign, deliver, result):
    deliver(campaign, result(3, Outcome.COLLISION))
    text = look(f"/campaigns/{campaign}/episodes/3")
    assert "Scene from above" in text
    assert "25.0 m²/s² (relative speed 5.00 m/s)" in text
    assert "4 (0.400 s)" in text


def test_an_episode_says_when_it_was_in_danger_and_how_it_was_driven(
    look, campaign, deliver, result
):
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
    text = look(f"/campaigns/{campaign}/episodes/0")
    assert "Class collision, planner failure" in text
    assert "MinTTC 0.100 s < 1.5 s 1.50 s 2.25 s" in text
    assert "> 7 m/s² never –" in text
    assert "first fell below 1.5 s, DRAC was 6.50 m/s²" in text
    assert "1.5 s TTC below 1.5 s 3.8 s collision" in text
    assert "Left the road never Largest jerk 12.5 m/s³ Hard brakings 2" in text
    assert "Clipped steps 0" in text


def test_an_episode_of_the_first_release_has_no_class_if_it_collided(
    look, campaign, deliver, result
):
    deliver(campaign, result(3, Outcome.COLLISION), result(4))
    text = look(f"/campaigns/{campaign}/episodes/3")
    assert "Class not classified" in text
    assert "Hard brakings" not in text
    assert "Class no conflict" in look(f"/campaigns/{campaign}/episodes/4")


def test_a_campaign_counts_its_conflicts(look, campaign, deliver, result):
    assert "Planner failures" not in look(f"/campaigns/{campaign}")
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
    text = look(f"/campaigns/{campaign}")
    counted = "Near misses 1 of 5 Unavoidable 1 of 3 collisions Planner failures 2 of 3 collisions"
    assert counted in text
    assert "Lead time of MinTTC 2.00 s mean of 2" in text
    assert "Lead time of DRAC 0.250 s mean of 2" in text
    assert "Not classified" not in text


def test_who_ended_too_early_to_tell_stands_beside_the_failures(
    look, http, campaign, deliver, result
):
    ended = Measures(1.3, None, 0.2, 30.0, final_drac_mps2=22.0)
    deliver(campaign, replace(result(0), measures=ended), result(1))
    words = "1 of 2 had no collision within 10 s, but ended while braking could not avoid one"
    assert words in look(f"/campaigns/{campaign}")
    assert words in look(f"/campaigns/{campaign}/measures")
    assert "near miss, unresolved at the horizon" in look(f"/campaigns/{campaign}/episodes")
    text = look(f"/campaigns/{campaign}/episodes/0")
    assert "Class near miss, unresolved at the horizon" in text
    assert "At the last step DRAC was 22.0 m/s²." in text
    told = http.get(f"/api/v1/campaigns/{campaign}/summary").json()
    assert told["unresolved"] == {"count": 1, "not_known": 0, "horizon_s": 10.0}
    assert (told["failure_rate"]["k"], told["failure_rate"]["n"]) == (0, 2)


def test_an_episode_without_a_scene_says_why(look, campaign, deliver, result):
    deliver(campaign, result(3))
    text = look(f"/campaigns/{campaign}/episodes/3")
    assert "those of all collisions and every 50th of the others" in text
    assert "Replay now" in text


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
    look, http, store, campaign, deliver_failed
):
    deliver_failed(campaign, *range(10))
    store.campaigns.move(campaign, CampaignState.DONE)
    errored = '<span class="badge tone-bad"><span aria-hidden="true">!</span> errored</span>'
    why = (
        "All 10 episodes errored, so there is no result. Most frequent reason (planner): It raised."
    )
    for address in (f"/campaigns/{campaign}", "/"):
        page = http.get(address).text
        assert errored in page
        assert "tone-good" not in page
    assert "10 errored" in look("/")
    assert why in look(f"/campaigns/{campaign}")
    page = http.get(f"/campaigns/{campaign}").text
    assert "No failure was found" not in page
    assert f"/campaigns/{campaign}/episodes?filter=outcome%20%3D%20errored" in page
    listed = look(f"/campaigns/{campaign}/episodes?filter=outcome%20%3D%20errored")
    assert "10 episodes" in listed
    assert listed.count("errored") >= 10
    assert "! errored" in look(f"/comparison?campaign={campaign}")


@pytest.mark.fault("campaign resumed by another release")
def test_a_campaign_of_two_releases_says_so_on_page_and_in_its_report(
    look, http, store, campaign, deliver_one
):
    for version in ("1.0.0", "1.1.0"):
        store.campaigns.begin_part(campaign, {"eigenfail": version})
        deliver_one(campaign)
    words = "went on with other versions after 1 result: eigenfail 1.0.0 then, 1.1.0 now."
    assert words in look(f"/campaigns/{campaign}")
    report = http.get(f"/api/v1/report?campaign={campaign}&format=json").json()
    assert any(words in warning for warning in report["warnings"])
    told = http.get(f"/api/v1/campaigns/{campaign}").json()
    assert [part["results"] for part in told["parts"]] == [0, 1]


def test_a_share_of_errored_episodes_stands_beside_the_rate(
    look, http, campaign, deliver_failed, result
):
    deliver_failed(campaign, 2, 3, beside=(result(0, Outcome.COLLISION), result(4)))
    words = "2 of 4 episodes errored and are not counted in the rate."
    assert words in look(f"/campaigns/{campaign}")
    assert "of 2 50.0 %" in (row := look("/"))
    assert "] 2 errored" in row
    told = http.get(f"/api/v1/campaigns/{campaign}/summary").json()
    assert told["errored"] == {
        "count": 2,
        "kind": "planner",
        "reason": "It raised.",
        "times": 2,
        "first": 2,
    }
    assert told["failure_rate"]["n"] == 2


def test_errored_episodes_stand_beside_the_rate_where_others_are_unresolved(
    look, campaign, deliver_failed, result
):
    ended = Measures(1.3, None, 0.2, 30.0, final_drac_mps2=22.0)
    deliver_failed(campaign, 2, beside=(replace(result(0), measures=ended), result(1)))
    assert "1 errored, 1 unresolved" in look("/")


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


def test_an_episode_that_errored_says_why(look, campaign, deliver, failed):
    deliver(campaign, failed(3))
    text = look(f"/campaigns/{campaign}/episodes/3")
    assert "! errored" in text
    assert "planner: It raised." in text


def test_the_next_failure_is_one_click_away(http, campaign, deliver, result):
    deliver(campaign, result(1, Outcome.COLLISION), result(2), result(5, Outcome.COLLISION))
    page = http.get(f"/campaigns/{campaign}/episodes/1").text
    assert f'href="/campaigns/{campaign}/episodes/5"' in page
    assert "Next failure" not in http.get(f"/campaigns/{campaign}/episodes/5").text


def test_an_analysis_waits_fails_or_shows_its_modes(look, store, campaign, finished):
    waiting = store.analyses.create(campaign, store.analyses.get(finished(2)).settings).id
    assert "queued or running" in look(f"/analyses/{waiting}")
    store.analyses.fail(waiting, "There are no failures to analyse.")
    assert "There are no failures to analyse." in look(f"/analyses/{waiting}")
    text = look(f"/analyses/{finished(2)}")
    assert "No distinct modes: the failures make a single group." in text
    assert "episode 1" in text


@pytest.mark.parametrize(
    ("address", "status", "words"),
    [
        ("/campaigns/7", 404, "Not found"),
        ("/campaigns/seven", 422, "Invalid value"),
        ("/analyses/7", 404, "Not found"),
        ("/nowhere", 404, "/nowhere does not exist."),
        ("/?bfore=3", 422, "before"),
    ],
)
def test_problems_are_pages_for_browsers(look, address, status, words):
    text = look(address, status)
    assert words in text
    assert "All campaigns" in text


def test_problems_stay_problems_for_programs(http, problem):
    problem(http.get("/campaigns/7"), 404)
    problem(http.get("/api/v1/campaigns/7", headers={"accept": "text/html,*/*;q=0.8"}), 404)
    problem(http.get("/api/v1/campaigns/7", headers=HTML), 406)


@pytest.mark.parametrize("address", ["/", "/campaigns/7", "/static/js/main.js"])
def test_everything_is_sent_under_the_strict_policy(http, address):
    headers = http.get(address, headers=HTML).headers
    assert "script-src 'self'; style-src 'self'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


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
    assert first.headers["cache-control"] == "no-cache"
    again = http.get("/static/js/main.js", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_nothing_outside_of_the_static_folder_is_sent(http):
    assert http.get("/static/%2e%2e/pages.py").status_code == 404
    assert http.get("/static/js/").status_code == 404


def test_pages_are_not_part_of_the_api(http):
    assert not [path for path in http.get("/openapi.json").json()["paths"] if "static" in path]
    assert "/" not in http.get("/openapi.json").json()["paths"]


def test_an_episode_of_a_campaign_that_varies_shows_what_it_drew(
    http, look, fields, deliver, result
):
    varied = fields | {"scenario_parameters": {"distance_m": {"choice": [61.25]}}}
    campaign = http.post("/api/v1/campaigns", json=varied).json()["id"]
    deliver(campaign, result(3, Outcome.COLLISION))
    text = look(f"/campaigns/{campaign}/episodes/3")
    assert "Sampled scenario parameters distance_m 61.25" in text
    assert "4 (0.400 s)" in text  # the time step is the scenario's, so it could be staged
