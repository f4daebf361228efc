"""Campaigns that name the channels of their noise, on a road, from the request to the page."""

import deadlines
import httpx2
import numpy as np
import pytest
from pyarrow import parquet
from short_searches import SEARCHES, wait_until_done

from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.suites import Suite
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.disturbance import list_noise
from eigenfail.values.episode import Outcome
from eigenfail.worlds import drawn_for, placed_for

pytestmark = pytest.mark.service

CHAIN = {"kind": "markov", "rate": 0.05, "mean_steps": 8, "rate_per_m": 0.0005}
MISSED = {"name": "missed", "shape": CHAIN}
ONE = (MISSED,)
SIX = (
    {"name": "scenario.distance_m"},
    {"name": "every.longitudinal", "shape": {"kind": "ar1", "correlation": 0.8}},
    {"name": "lateral", "sigma": 0.4},
    {"name": "heading", "shape": {"kind": "student_t", "degrees_of_freedom": 4}},
    {"name": "ghost", "shape": {"kind": "markov", "rate": 0.02}},
    MISSED,
)


def create(client, channels, method, episodes, settings, **fields):
    return client.campaigns.create(
        name=f"{method} on {len(channels)}",
        method=method,
        episodes=episodes,
        settings=settings,
        seed=5,
        planner="idm",
        disturbance={"channels": list(channels)},
        scenario_parameters={"distance_m": {"uniform": [53.0, 63.0]}},
        **fields,
    )


def test_every_search_works_in_all_channels(client, lasting_worker) -> None:
    started = [create(client, SIX, name, *given) for name, given in SEARCHES.items()]
    for campaign in started:
        ended = wait_until_done(client, campaign)
        assert ended.counts.errored == 0
        stored = client.episodes.get(campaign.id, ended.counts.completed - 1)
        assert stored.noise.z.shape == (stored.steps, len(SIX))
        assert np.isfinite(stored.noise.log_probability)
        events = stored.noise.injected[:, -1]
        assert set(events.tolist()) <= {0.0, 1.0}


@pytest.fixture(scope="module")
def failing(service, lasting_worker):
    """A search in six channels that is done; no test changes it."""
    with Client(service.address.url) as client:
        return wait_until_done(client, create(client, SIX, "held", 120, {}, scene_every=1))


def first_failure(client, campaign) -> int:
    return next(iter(client.episodes.list(campaign.id, outcome=Outcome.COLLISION))).index


def test_a_stored_campaign_says_what_each_channel_is(client, failing) -> None:
    names = [channel.name for channel in failing.spec.disturbance.channels]
    assert names[:2] == ["scenario.distance_m", "vehicle_1.longitudinal"]
    assert names[2:] == ["lateral", "heading", "ghost", "missed"]
    assert failing.spec.disturbance.channels[3].sigma == 0.02
    page = httpx2.get(f"{client.url}/campaigns/{failing.id}").raise_for_status().text
    assert "begins with probability 0.05 + 0.0005·d a step" in page


def test_tables_of_noise_have_the_channels_with_their_units(client, failing, tmp_path) -> None:
    file = client.episodes.export(failing.id, tmp_path / "episodes.parquet", noise=True)
    columns = [name for name in parquet.read_table(file).column_names if name.endswith("_z")]
    assert columns == [f"{each.name}_z" for each in failing.spec.disturbance.channels]
    episode = client.episodes.get(failing.id, 0)
    first = next(list_noise(episode.noise, episode.channels))
    assert {"heading_sigma_rad", "heading_rad", "missed", "missed_sigma", "lateral_m"} <= {*first}


def test_an_episode_is_replayed_bit_for_bit_and_explained(client, failing) -> None:
    index = first_failure(client, failing)
    replayed = wait_until_done(client, client.episodes.replay(failing.id, index))
    again, stored = client.episodes.get(replayed.id, 0), client.episodes.get(failing.id, index)
    assert again.noise.injected.tobytes() == stored.noise.injected.tobytes()
    assert replayed.counts.failures == 1
    placed = placed_for(failing.spec, stored.noise)
    assert 53.0 <= placed["distance_m"] <= 63.0
    assert placed == placed_for(replayed.spec, again.noise)
    assert drawn_for(failing.spec, stored.seed) == {}
    page = httpx2.get(f"{client.url}/campaigns/{failing.id}/episodes/{index}").text
    assert f"{placed['distance_m']}" in page
    explained = client.episodes.explanation(failing.id, index)
    assert len(explained.steps[0].disturbance) == len(SIX)
    for path in (f"campaigns/{failing.id}", f"api/v1/campaigns/{failing.id}"):
        suffix = "/steps" if path.startswith("api") else ""
        answer = httpx2.get(f"{client.url}/{path}/episodes/{index}{suffix}").raise_for_status()
        assert "vehicle_1.longitudinal" in answer.text.lower()


def test_failures_are_grouped_in_all_channels_or_in_one(client, failing) -> None:
    joint = client.analyses.wait(client.analyses.create(failing.id).id)
    assert joint.state is AnalysisState.DONE, joint.problem
    assert joint.result.modes[0].eigenfailure.shape[1] == len(SIX)
    client.analyses.prove(joint.id)
    proof = client.analyses.wait_for_proof(joint.id, timeout_s=deadlines.CAMPAIGN_S)
    assert proof.medoids.rate is not None
    assert proof.medoids.rate.k == proof.medoids.rate.n == len(joint.result.modes)
    alone = client.analyses.wait(client.analyses.create(failing.id, axes="missed").id)
    assert alone.state is AnalysisState.DONE, alone.problem
    page = httpx2.get(f"{client.url}/analyses/{joint.id}").raise_for_status().text
    assert "missed" in page.lower()


def test_a_suite_finds_its_campaigns_again(client, lasting_worker, tmp_path) -> None:
    file = tmp_path / "channels.toml"
    file.write_text(
        '[base]\nmethod = "held"\nepisodes = 4\nplanner = "idm"\n'
        '[[base.disturbance.channels]]\nname = "every.speed"\n[sweep]\nseed = [1, 2]\n'
    )
    suite = Suite.read(file)
    created = client.suites.create(suite)
    found = client.suites.find(suite)
    assert [each.id for each in found] == [each.id for each in created]


def test_noise_of_a_searched_scenario_is_not_scaled_nor_shrunk(client, failing) -> None:
    index = first_failure(client, failing)
    with pytest.raises(InvalidValue, match="scale 1"):
        client.episodes.replay(failing.id, index, scale=0.5)
    with pytest.raises(InvalidValue, match="is chosen by the noise"):
        client.campaigns.shrink(failing.id, index)


def test_a_replay_of_noise_of_other_channels_is_refused(client, failing) -> None:
    settings = {"campaign": failing.id, "episodes": [0]}
    with pytest.raises(InvalidValue, match="another number of channels: 6 there, 1 here"):
        create(client, ONE, "replay", 1, settings)
    with pytest.raises(InvalidValue, match=r"has other channels: scenario\.distance_m, vehicle_1"):
        create(client, SIX[::-1], "replay", 1, settings)
