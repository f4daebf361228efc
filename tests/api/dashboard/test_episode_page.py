"""What the episode's page leads to: account, clip, replay."""

import pytest
from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.errors import ServiceBusy, ServiceError
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.operations import Arrival
from eigenfail.values.proof import ExplainedStep, Explanation, Replayed
from eigenfail_api.dashboard import episode_page


@pytest.fixture
def explained(monkeypatch):
    """Has the service explain every episode as given, or refuse."""

    def use(told):
        def of(_store, _campaign, _index):
            if isinstance(told, Exception):
                raise told
            return told

        monkeypatch.setattr(episode_page.EXPLANATIONS, "of", of)

    return use


def explanation(same, accounts, scene=None):
    outcome = Outcome.COLLISION
    steps = tuple(
        ExplainedStep(0.1 * n, 0.0, 0.0, account, (0.0, 0.0), 9.0, 2.0, ((0.0, 0.0), (5.0, 0.0)))
        for n, account in enumerate(accounts)
    )
    replayed = Replayed(0, outcome, "a", outcome, "a" if same else "b", same)
    story = ("At 0.1 s it <looked> away.",)
    return Explanation("1/0", "mine", replayed, "The verdict.", "A note.", steps, story, scene)


ACCOUNTS = [
    {"mode": "highway", "lost_tracks": 0.0, "override": "none"},
    {"mode": "highway", "lost_tracks": 1.0, "override": "none"},
    {"mode": "highway", "lost_tracks": 1.0, "override": "emergency_brake"},
]


def test_an_account_has_story_moments_and_verdict(check_page, campaign, deliver, result, explained):
    deliver(campaign, result(0, Outcome.COLLISION))
    explained(explanation(True, ACCOUNTS))
    check_page("dashboard/account/same", f"/campaigns/{campaign}/episodes/0/account")


def test_a_failure_of_a_function_shows_its_robustness_alone(look, store, deliver, result):
    spec = CampaignSpec(
        name="f",
        method="monte_carlo",
        episodes=2,
        simulator="function",
        scenario="function",
        planner="my_module:robustness",
        scenario_parameters={"steps": 4},
    )
    campaign = store.campaigns.create(accept_spec(spec)).id
    deliver(campaign, replace(result(0, Outcome.COLLISION), scene=None, measures=Measures(0.0)))
    text = look(f"/campaigns/{campaign}/episodes/0")
    assert "Robustness 0 log p" in text
    for absent in ("Footprints apart", "never", "Severity", "not classified", "MinTTC", "Ride"):
        assert absent not in text


def test_an_account_of_another_course_is_not_put_beside_this_one(
    check_page, campaign, deliver, result, explained
):
    deliver(campaign, result(0, Outcome.COLLISION))
    explained(explanation(False, ACCOUNTS))
    check_page("dashboard/account/another_course", f"/campaigns/{campaign}/episodes/0/account")


def test_the_scene_of_the_replay_is_played_where_none_was_kept(
    check_page, campaign, deliver, result, explained
):
    deliver(campaign, result(0))
    explained(explanation(True, ACCOUNTS, result(1, Outcome.COLLISION).scene))
    check_page("dashboard/account/scene_of_replay", f"/campaigns/{campaign}/episodes/0/account")


def test_without_an_account_the_part_says_why(check_page, campaign, deliver, result, explained):
    deliver(campaign, result(0))
    explained(ServiceError("Episodes cannot be run here.", "Run in a clone: pip install …"))
    check_page("dashboard/account/missing", f"/campaigns/{campaign}/episodes/0/account")


def test_an_account_that_others_hold_up_is_refused_for_now(
    look, campaign, deliver, result, explained
):
    deliver(campaign, result(0))
    explained(ServiceBusy("Others come first."))
    look(f"/campaigns/{campaign}/episodes/0/account", 503)


def test_an_unknown_episode_has_no_account(look, campaign):
    look(f"/campaigns/{campaign}/episodes/4/account", 404)


@pytest.mark.parametrize("moment", ["?t=4.2", "?t=0"])
def test_an_address_may_name_a_moment(look, campaign, deliver, result, moment):
    deliver(campaign, result(0, Outcome.COLLISION))
    look(f"/campaigns/{campaign}/episodes/0{moment}")


@pytest.mark.parametrize("moment", ["?t=-1", "?t=nan", "?t=soon"])
def test_a_moment_that_is_none_is_refused(look, campaign, deliver, result, moment):
    deliver(campaign, result(0, Outcome.COLLISION))
    look(f"/campaigns/{campaign}/episodes/0{moment}", 422)


def test_a_clip_is_a_small_player(check_page, campaign, deliver, result):
    deliver(campaign, result(0, Outcome.COLLISION), result(1))
    check_page("dashboard/clip/collision", f"/campaigns/{campaign}/episodes/0/clip")
    check_page("dashboard/clip/without_scene", f"/campaigns/{campaign}/episodes/1/clip")


def test_a_replay_is_awaited_until_it_arrives_or_ends(check_page, campaign, deliver, result):
    check_page("dashboard/replay/awaited", f"/replays/{campaign}")
    deliver(campaign, result(0))
    check_page("dashboard/replay/arrived", f"/replays/{campaign}")


def test_a_replay_that_came_to_nothing_says_so(check_page, store, campaign):
    store.campaigns.move(campaign, CampaignState.CANCELLED)
    check_page("dashboard/replay/cancelled", f"/replays/{campaign}")


def test_a_replay_leads_back_to_what_it_repeats(check_page, http, campaign, deliver, result):
    deliver(campaign, result(0, Outcome.COLLISION))
    again = http.post(f"/api/v1/campaigns/{campaign}/episodes/0/replay").json()["id"]
    deliver(again, result(0, Outcome.COLLISION))
    check_page("dashboard/episode/replayed", f"/campaigns/{again}/episodes/0")
    check_page("dashboard/replay/same", f"/replays/{again}")


@pytest.fixture
def replays(http, campaign, deliver, result):
    """Replays an episode, delivers what comes of it, and gives the address of that."""
    deliver(campaign, result(0, Outcome.COLLISION))

    def make(came_of_it, scale=1.0):
        path = f"/api/v1/campaigns/{campaign}/episodes/0/replay"
        again = http.post(path, json={"scale": scale}).json()["id"]
        deliver(again, came_of_it)
        return again

    return make


def test_a_replay_that_differs_is_doubted(look, check_page, result, replays):
    again = replays(result(0))
    check_page("dashboard/replay/differs", f"/replays/{again}")
    courses = "Stored: collision after 4 steps; replayed: safe after 4 steps."
    assert f"Different result. {courses}" in look(f"/campaigns/{again}/episodes/0")


def test_a_replay_under_other_versions_names_them(
    *, standing_clock, store, campaign, deliver, result, look, http
):
    def arrive(numpy):
        standing_clock.now_ms += 1  # who comes in one millisecond with a result may have brought it
        told = {"worker": "worker-1", "host": "", "pid": 1}
        store.roster.arrived([Arrival(**told, versions={"numpy": numpy})])

    arrive("2.4.5")
    deliver(campaign, result(0, Outcome.COLLISION))
    path = f"/api/v1/campaigns/{campaign}/episodes/0"
    assert http.get(f"{path}/worker").json()["versions"] == {"numpy": "2.4.5"}
    arrive("2.4.6")
    again = http.post(f"{path}/replay", json={}).json()["id"]
    deliver(again, result(0))
    text = look(f"/campaigns/{again}/episodes/0")
    assert "with other versions (numpy 2.4.5 then, 2.4.6 now)" in text


def test_of_a_worker_that_never_connected_nothing_is_known(http, campaign, deliver, result):
    deliver(campaign, result(0))
    told = http.get(f"/api/v1/campaigns/{campaign}/episodes/0/worker")
    assert told.status_code == 404
    assert "worker-1" in told.json()["detail"]


def test_a_replay_of_scaled_noise_is_expected_to_differ(check_page, result, replays):
    check_page("dashboard/replay/scaled", f"/replays/{replays(result(0), scale=0.5)}")


def test_a_replay_elsewhere_says_what_is_other_there(check_page, store, campaign, deliver, result):
    deliver(campaign, result(0, Outcome.COLLISION))
    spec = replace(
        store.campaigns.get(campaign).spec,
        method="replay",
        settings={"campaign": campaign, "episodes": (0,)},
        planner="rulebook",
        scenario_parameters={"distance_m": 60.0},
    )
    again = store.campaigns.create(accept_spec(spec)).id
    deliver(again, result(0))
    check_page("dashboard/replay/elsewhere", f"/replays/{again}")


def test_a_replay_whose_source_has_no_result_is_not_judged(
    check_page, store, campaign, deliver, result
):
    settings = {"campaign": campaign, "episodes": (7,)}
    spec = replace(store.campaigns.get(campaign).spec, method="replay", settings=settings)
    again = store.campaigns.create(accept_spec(spec)).id
    deliver(again, result(0))
    check_page("dashboard/replay/without_source", f"/replays/{again}")
