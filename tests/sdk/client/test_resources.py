"""What users do with the client, against the whole API."""

from contextlib import closing

import msgspec
import numpy as np
import pytest
from store_checks.examples import deliver as store_results
from store_checks.examples import name_channels, result_of, running

from eigenfail import errors
from eigenfail.client import Client
from eigenfail.testing.examples import collision, make_errored_result
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, FailureMode
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import DisturbanceModel, list_noise
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail_api.routes import operations


@pytest.fixture
def campaign(client, fields):
    return client.campaigns.create(**fields)


@pytest.fixture
def deliver(store, campaign):
    def commit(*results):
        store.campaigns.move(campaign.id, CampaignState.RUNNING)
        store.episodes.commit(campaign.id, [Delivery(result, "w") for result in results])

    return commit


@pytest.fixture
def analysis(client, store, campaign):
    """The id of an analysis that is done."""
    made = client.analyses.create(campaign.id)
    z, one = np.ones((4, 2), np.float32), np.ones(1, np.float32)
    store.analyses.start(made.id)
    modes = (FailureMode(3, 0, one, z), FailureMode(1, 3, one, -z))
    found = AnalysisResult((0,), one, z[None], one[None], (0,), modes, z, None, None)
    store.analyses.finish(made.id, found)
    return made.id


def test_a_campaign_is_created_from_a_spec_or_from_fields(client, fields, store):
    by_spec = client.campaigns.create(CampaignSpec(**fields))
    by_fields = client.campaigns.create(**fields, disturbance=DisturbanceModel())
    assert by_spec.id != by_fields.id
    assert by_spec.spec == by_fields.spec == CampaignSpec(**fields)
    assert store.campaigns.get(by_spec.id) == by_spec == client.campaigns.get(by_spec.id)


def test_what_is_wrong_with_a_campaign_is_told_with_the_known_names(client, fields):
    with pytest.raises(errors.UnknownName) as refusal:
        client.campaigns.create(**fields | {"planner": "rulebok"})
    assert (refusal.value.field, refusal.value.name) == ("planner", "rulebok")
    assert "rulebook" in refusal.value.known
    assert "Did you mean 'rulebook'?" in str(refusal.value)
    with pytest.raises(errors.UnknownName, match="Did you mean 'episodes'"):
        client.campaigns.create(**fields, episode=3)
    with pytest.raises(errors.UnknownName, match="lateral_slope"):
        client.campaigns.create(**fields, disturbance={"slope": 1.0})
    with pytest.raises(errors.InvalidValue, match="name: is required"):
        client.campaigns.create(method="monte_carlo", episodes=3)
    with pytest.raises(errors.InvalidValue, match="object"):
        client.campaigns.create(**fields, settings={"round_size": object()})


def test_lists_go_over_pages(client, fields, monkeypatch):
    monkeypatch.setattr("eigenfail.client.link.PAGE", 2)
    ids = [client.campaigns.create(**fields).id for _ in range(5)]
    assert [campaign.id for campaign in client.campaigns.list()] == ids[::-1]
    client.campaigns.pause(ids[0])
    assert [campaign.id for campaign in client.campaigns.list("paused")] == ids[:1]
    assert [summary.campaign for summary in client.campaigns.summaries()] == ids[::-1]


def test_wishes(client, campaign):
    assert client.campaigns.pause(campaign.id).state == "paused"
    assert client.campaigns.resume(campaign.id).state == "queued"
    assert client.campaigns.cancel(campaign.id).state == "cancelled"
    with pytest.raises(errors.IllegalTransition, match="cannot be resumed"):
        client.campaigns.resume(campaign.id)


def test_waiting_ends_with_the_campaign_and_tells_of_progress(client, campaign, store):
    path = iter([CampaignState.RUNNING, CampaignState.DONE])
    seen = []

    def watch(now):
        seen.append(now.state)
        store.campaigns.move(now.id, next(path)) if now.state != "done" else None

    ended = client.campaigns.wait(campaign.id, on_progress=watch, poll_s=0.0)
    assert ended.state == "done"
    assert ended.digest == client.campaigns.digest(campaign.id)
    assert seen == ["queued", "running", "done"]


def test_waiting_ends_at_a_pause_and_after_the_time_that_was_given(client, campaign):
    seen = rf"Campaign {campaign.id} \({campaign.spec.name}; queued, 0 of .* completed\)"
    with pytest.raises(errors.WaitTimeout, match=f"{seen} is still running after 0 s"):
        client.campaigns.wait(campaign.id, poll_s=0.0, timeout_s=0.0)
    client.campaigns.pause(campaign.id)
    assert client.campaigns.wait(campaign.id).state == "paused"


def test_summary_and_digest(client, campaign, deliver):
    before = client.campaigns.digest(campaign.id)
    deliver(collision(0))
    assert client.campaigns.summary(campaign.id).failure_rate.k == 1
    assert client.campaigns.digest(campaign.id) != before


def test_an_episode_comes_back_to_the_last_bit(client, campaign, deliver):
    deliver(collision(0), make_errored_result(1))
    told = client.episodes.get(campaign.id, 0)
    assert told.digest() == collision(0).digest()
    assert told.noise.log_probability == collision(0).noise.log_probability
    assert told.scene.vehicles.dtype == np.float32
    assert told.scene.vehicles.shape == (4, 2, 4)


def test_an_episode_is_told_on_few_lines(client, campaign, deliver):
    deliver(collision(0))
    said = repr(client.episodes.get(campaign.id, 0))
    assert said.startswith("EpisodeDetail(index=0, seed=100, outcome=<Outcome.COLLISION")
    assert "noise=NoiseTrajectory(z=<float32 (3, 2)>, sigma=<float32 (3, 2)>" in said
    assert "vehicles=<float32 (4, 2, 4)>" in said
    assert "assessed=Assessment(" in said
    assert len(said) < 2_000


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_episodes_name_the_channels_of_their_noise(client, store, channels):
    campaign = running(store, **name_channels(channels))
    lost = make_errored_result(1)
    store_results(store, campaign, result_of(channels), lost)
    told = client.episodes.get(campaign.id, 0)
    assert told.channels == tuple(f"c{number}" for number in range(channels))
    assert told.noise.z.tobytes() == result_of(channels).noise.z.tobytes()
    steps = list(list_noise(told.noise, told.channels))
    assert list(steps[0]) == [
        "step", *(f"{name}{kind}" for name in told.channels for kind in ("", "_z", "_sigma"))
    ]  # fmt: skip
    assert [step[f"c{channels - 1}_z"] for step in steps] == told.noise.z[:, -1].tolist()
    nothing = client.episodes.get(campaign.id, 1)
    assert nothing.noise.z.shape == nothing.noise.sigma.shape == (0, channels)


def test_episodes_are_found_by_a_filter(client, campaign, deliver):
    worse = msgspec.structs.replace(collision(2), measures=Measures(0.0, severity=16.0))
    deliver(collision(0), make_errored_result(1), worse)
    assert [row.index for row in client.episodes.list(campaign.id, filter="severity > 9")] == [2]
    with pytest.raises(errors.UnknownName, match="Did you mean 'severity'") as refusal:
        list(client.episodes.list(campaign.id, filter="sevrity > 9"))
    assert refusal.value.field == "filter, character 1"
    picked = client.episodes.list(campaign.id, sort="-severity", fields=["index", "severity"])
    assert list(picked)[:2] == [{"index": 2, "severity": 16.0}, {"index": 0, "severity": 2.5}]


def test_analyses_are_made_waited_for_and_listed(client, campaign, analysis):
    waiting = client.analyses.create(campaign.id, AnalysisSettings(clusters=3))
    assert waiting.settings.clusters == 3
    assert client.analyses.wait(analysis).result.modes[1].medoid == 3
    assert client.analyses.get(analysis).result.components.shape == (1, 4, 2)
    assert [each.id for each in client.analyses.list(campaign.id)] == [waiting.id, analysis]
    with pytest.raises(errors.ServiceError):
        client.analyses.wait(waiting.id, poll_s=0.0, timeout_s=0.0)


def test_modes_are_listed_and_named(client, analysis):
    assert [mode.name for mode in client.analyses.modes(analysis)] == ["Mode 1", "Mode 2"]
    second = client.analyses.eigenfailures(analysis)[1]
    assert second.number == 2
    renamed = client.analyses.rename_mode(analysis, second, "  late\tbraking ")
    assert (renamed.number, renamed.name) == (2, "late braking")
    assert client.analyses.modes(analysis)[1] == renamed
    with pytest.raises(errors.NotFound, match="has no mode 3"):
        client.analyses.rename_mode(analysis, 3, "third")
    for name in ("", " ", "a\x00b", "x" * 81):
        with pytest.raises(errors.InvalidValue, match="name"):
            client.analyses.rename_mode(analysis, 1, name)


def test_eigenfailures_and_medoids_are_replayed(client, campaign, analysis, store):
    first, second = client.analyses.eigenfailures(analysis)
    assert np.array_equal(second.eigenfailure, -first.eigenfailure)
    asked = client.analyses.prove(analysis, [{}, {"distance_m": 63.0}])
    assert [each.scenario_parameters for each in asked.scenarios] == [{}, {"distance_m": 63.0}]
    farther = client.campaigns.get(asked.scenarios[1].campaign).spec
    assert (farther.episodes, farther.scenario_parameters) == (4, {"distance_m": 63.0})
    assert not client.analyses.proof(analysis).done
    with pytest.raises(
        errors.WaitTimeout, match=f"The proof of analysis {analysis} is still running"
    ):
        client.analyses.wait_for_proof(analysis, poll_s=0.0, timeout_s=0.0)
    for each in asked.scenarios:
        store.campaigns.move(each.campaign, CampaignState.CANCELLED)
    assert client.analyses.wait_for_proof(analysis).done
    unfinished = client.analyses.create(campaign.id)
    with pytest.raises(errors.Conflict, match="queued"):
        client.analyses.prove(unfinished.id)


def test_events_are_followed(client, campaign, store):
    with closing(client.events.follow()) as follower:
        first = next(follower)
        assert first.campaign == campaign.id
        client.campaigns.pause(campaign.id)
        second = next(follower)
        assert second.id > first.id
    with closing(client.events.follow(after=first.id, campaign=campaign.id)) as follower:
        assert next(follower) == second
    with pytest.raises(errors.NotFound):
        next(client.events.follow(campaign=99))


def test_plugins_are_listed(client):
    assert "monte_carlo" in {plugin.name for plugin in client.methods()}
    assert "idm" in {plugin.name for plugin in client.planners()}
    assert "cut_in" in {plugin.name for plugin in client.scenarios()}
    assert "point_mass" in {plugin.name for plugin in client.simulators()}


def test_health(client, store, monkeypatch):
    monkeypatch.setattr(operations, "MAX_AGE_S", 0.0)
    assert client.health()
    assert client.trouble() is None

    def full():
        raise errors.StoreUnwritable("The disk is full.", "Make room.")

    monkeypatch.setattr(store, "ping", full)
    assert isinstance(trouble := client.trouble(), errors.StoreUnwritable)
    assert trouble.remedy == "Make room."
    monkeypatch.setattr(store, "ping", lambda: 1 / 0)
    assert not client.health()


def test_an_episode_is_replayed_as_a_campaign(client, campaign, deliver):
    deliver(collision(0))
    made = client.episodes.replay(campaign.id, 0, scale=0.5)
    assert made.spec.method == "replay"
    assert made.spec.settings["scale"] == 0.5
    assert list(client.suites.list()) == []
    with pytest.raises(errors.InvalidValue, match="scale"):
        client.episodes.replay(campaign.id, 0, scale=9.0)


def test_settings_of_an_analysis_are_given_by_name(client, campaign):
    assert client.analyses.create(campaign.id, clusters=2).settings.clusters == 2
    with pytest.raises(errors.UnknownName, match="Did you mean 'clusters'"):
        client.analyses.create(campaign.id, cluster=2)


def test_variations_of_a_proof_are_a_list(client):
    with pytest.raises(errors.InvalidValue, match="variations"):
        client.analyses.prove(1, {"distance_m": 60.0})


def test_an_address_has_a_scheme():
    with pytest.raises(errors.InvalidValue, match="'8463' is not an address"):
        Client(8463)
    with pytest.raises(errors.InvalidValue, match="'localhost' is not an address"):
        Client("localhost")


def test_a_closed_client_says_so(client):
    client.close()
    with pytest.raises(errors.ServiceUnreachable, match="is closed"):
        client.campaigns.get(1)
