"""An episode again, over HTTP: its explanation, its replay, its steps."""

import asyncio
import csv
import io
import threading
from contextlib import asynccontextmanager
from time import sleep

import numpy as np
import pytest
from accepted import accept_spec
from store_checks.examples import deliver as store_results
from store_checks.examples import name_channels, result_of, running

from eigenfail import plugins
from eigenfail.errors import ServiceBusy
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import (
    EpisodeFault,
    EpisodeResult,
    EpisodeTask,
    Outcome,
    TrajectorySource,
)
from eigenfail_api import concurrency
from eigenfail_api.concurrency import (
    MOST_RUNNING,
    MOST_WAITING,
    ConcurrencyLimit,
    SerialExecutor,
)
from eigenfail_services.campaigns.explanations import Explanations

SIGN = np.where((np.arange(100) // 20) % 2 == 0, 2.0, -2.0)
WAVE = np.stack([SIGN, 0.0 * SIGN], axis=1).astype(np.float32)


@pytest.fixture
def crash(store, deliver):
    """Makes a collision of the rulebook planner, index 3 of a campaign; its address."""

    def make(**fields):
        wanted = {"name": "wave", "method": "monte_carlo", "episodes": 9, **fields}
        spec = CampaignSpec(**wanted)
        campaign = store.campaigns.create(accept_spec(spec)).id
        engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        (result,) = engine.run([EpisodeTask(3, 5, TrajectorySource(WAVE))])
        deliver(campaign, result)
        return f"/api/v1/campaigns/{campaign}/episodes/3"

    return make


def test_the_planner_accounts_for_each_step_of_the_stored_episode(http, crash):
    address = crash()
    stored = http.get(address).json()
    told = http.get(f"{address}/explanation").json()
    assert told["replayed"]["same"]
    assert len(told["steps"]) == stored["steps"]
    step = told["steps"][20]
    assert {"mode", "rule", "heeds"} <= step["account"].keys()
    assert 2 <= len(step["path"]) <= 20
    ego_x, ego_y = stored["scene"]["vehicles"][20][0][:2]
    assert step["path"][0] == pytest.approx([ego_x, ego_y], abs=1e-3)
    assert "collision" in told["story"][-1]
    assert told["scene"] is None


def test_a_planner_without_an_account_is_said_to_have_none(http, crash):
    told = http.get(f"{crash(planner='idm', simulator='point_mass')}/explanation").json()
    assert "provides no explanation" in told["note"]
    assert told["steps"][0]["path"] == []


def test_an_episode_that_never_ran_is_refused(http, campaign, deliver, problem):
    nothing = np.zeros((0, 2), np.float32)
    fault = EpisodeFault("infrastructure", "Three workers were lost.")
    noise = NoiseTrajectory(nothing, nothing)
    deliver(campaign, EpisodeResult(0, 0, Outcome.ERRORED, 0, noise, "prior", fault=fault))
    told = problem(http.get(f"/api/v1/campaigns/{campaign}/episodes/0/explanation"), 422)
    assert "Three workers were lost" in told["detail"]
    told = problem(http.post(f"/api/v1/campaigns/{campaign}/episodes/0/replay", json={}), 422)
    assert "no noise to replay" in told["detail"]


def test_an_unknown_episode_is_not_found(http, campaign, problem):
    problem(http.get(f"/api/v1/campaigns/{campaign}/episodes/7/explanation"), 404)
    problem(http.get(f"/api/v1/campaigns/{campaign}/episodes/7/steps"), 404)
    problem(http.post(f"/api/v1/campaigns/{campaign}/episodes/7/replay", json={}), 404)


def test_the_last_explanations_are_kept(store, campaign, deliver, result):
    deliver(campaign, result(0), result(1))
    asked = []
    made = Explanations(lambda question: asked.append(question) or object())
    first, second = made.of(store, campaign, 0), made.of(store, campaign, 1)
    assert made.of(store, campaign, 0) is first is not second
    assert len(asked) == 2


def test_too_many_that_wait_are_refused():
    one, gate = SerialExecutor("test"), threading.Event()

    async def crowd():
        waiting = [asyncio.create_task(one.do(gate.wait)) for _ in range(MOST_WAITING)]
        await asyncio.sleep(0)
        with pytest.raises(ServiceBusy):
            await one.do(gate.wait)
        gate.set()
        return await asyncio.gather(*waiting)

    assert asyncio.run(crowd()) == [True] * MOST_WAITING


@pytest.mark.fault("crowd that asks for costly answers")
def test_who_waits_too_long_for_a_process_is_refused_and_its_work_never_begins(monkeypatch):
    monkeypatch.setattr(concurrency, "LONGEST_WAIT_S", 0.05)
    one, gate, begun = SerialExecutor("test"), threading.Event(), []

    def work(number):
        begun.append(number)
        return gate.wait()

    async def crowd():
        first = asyncio.create_task(one.do(work, 0))
        await asyncio.sleep(0)
        with pytest.raises(ServiceBusy):
            await one.do(work, 1)
        gone = asyncio.create_task(one.do(work, 2))
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.gather(gone, return_exceptions=True)
        gate.set()
        return await first, await one.do(work, 3)

    assert asyncio.run(crowd()) == (True, True)
    assert begun == [0, 3]


@pytest.mark.fault(
    "crowd that asks for costly answers",
    group="api",
    outcome="Two of a kind are worked out at a time and eight wait; more get 503 and Retry-After.",
)
def test_costly_answers_are_worked_out_a_few_at_a_time():
    limit, running, most = ConcurrencyLimit("reports"), 0, 0
    gate = asyncio.Event()

    async def route():
        nonlocal running, most
        async with asynccontextmanager(limit.__call__)():
            running += 1
            most = max(most, running)
            await gate.wait()
            running -= 1

    async def crowd():
        asked = [asyncio.create_task(route()) for _ in range(MOST_RUNNING + MOST_WAITING)]
        await asyncio.sleep(0)
        with pytest.raises(ServiceBusy, match="10 reports"):
            await route()
        asked[-1].cancel()  # a client that waits no longer makes room
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        asked.append(asyncio.create_task(route()))
        gate.set()
        return await asyncio.gather(*asked, return_exceptions=True)

    found = asyncio.run(crowd())
    assert most == MOST_RUNNING
    assert sum(each is not None for each in found) == 1


def test_parts_of_streams_are_made_a_few_at_a_time_and_sent_without_a_place():
    limit, running, most, lock = ConcurrencyLimit("exports"), 0, 0, threading.Lock()

    def make_parts():
        nonlocal running, most
        for part in (b"a", b"b"):
            with lock:
                running += 1
                most = max(most, running)
            sleep(0.01)
            with lock:
                running -= 1
            yield part

    async def read():
        return [part async for part in limit.stream(make_parts())]

    async def crowd():
        # Clients that have read one part, and read no further, keep nobody waiting.
        slow = [limit.stream(make_parts()) for _ in range(MOST_RUNNING)]
        for each in slow:
            assert await anext(each) == b"a"
        return await asyncio.gather(*(read() for _ in range(6)))

    assert asyncio.run(crowd()) == [[b"a", b"b"]] * 6
    assert most == MOST_RUNNING


@pytest.mark.parametrize(
    "path",
    [
        "/api/v1/comparisons?a=1&b=2",
        "/api/v1/costs",
        "/api/v1/campaigns/1/cost",
        "/metrics",
        "/comparison",
        "/campaigns/1/measures",
    ],
)
@pytest.mark.fault("crowd that asks for costly answers")
def test_a_costly_route_refuses_a_crowd(http, campaign, monkeypatch, path):
    monkeypatch.setattr(concurrency, "MOST_WAITING", -MOST_RUNNING)
    refused = http.get(path)
    assert refused.status_code == 503
    assert refused.headers["retry-after"] == "1"
    monkeypatch.undo()
    assert http.get(path).status_code != 503


def test_a_replay_is_a_campaign_with_the_same_noise(http, crash, store):
    address = crash()
    campaign = http.post(f"{address}/replay", json={"scale": 0.5}).json()
    spec = store.campaigns.get(campaign["id"]).spec
    assert (spec.method, spec.episodes, spec.scene_every) == ("replay", 1, 1)
    assert spec.settings == {"campaign": 1, "episodes": [3], "scale": 0.5}
    assert "noise × 0.5" in spec.name


@pytest.mark.parametrize("scale", [0.0, 2.5])
def test_a_scale_out_of_bounds_is_refused(http, crash, problem, scale):
    told = problem(http.post(f"{crash()}/replay", json={"scale": scale}), 422)
    assert told["field"] == "scale"


def test_a_varied_scenario_is_replayed_as_it_was_drawn(http, crash, store):
    address = crash(scenario_parameters={"distance_m": {"uniform": [55.0, 60.0]}})
    campaign = http.post(f"{address}/replay", json={}).json()
    drawn = store.campaigns.get(campaign["id"]).spec.scenario_parameters["distance_m"]
    assert 55.0 <= drawn <= 60.0


def test_steps_are_a_table_with_the_scene(http, crash):
    address = crash()
    response = http.get(f"{address}/steps")
    assert response.headers["content-type"].startswith("text/csv")
    rows = [*csv.DictReader(io.StringIO(response.text))]
    stored = http.get(address).json()
    assert len(rows) == stored["steps"]
    z, sigma_m = stored["noise"]["z"][0], stored["noise"]["sigma"][0]
    assert float(rows[0]["longitudinal_z"]) == pytest.approx(z[0])
    assert float(rows[0]["lateral_m"]) == pytest.approx(z[1] * sigma_m[1])
    assert float(rows[4]["ego_x_m"]) == pytest.approx(stored["scene"]["vehicles"][4][0][0])
    assert min(float(row["clearance_m"]) for row in rows) >= 0.0


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_steps_name_the_channels_of_the_noise(http, store, channels):
    campaign = running(store, **name_channels(channels))
    store_results(store, campaign, result_of(channels))
    text = http.get(f"/api/v1/campaigns/{campaign.id}/episodes/0/steps").text
    rows = [*csv.DictReader(io.StringIO(text))]
    noise, names = result_of(channels).noise, [f"c{number}" for number in range(channels)]
    columns = [f"{name}{kind}" for kind in ("_z", "_sigma", "") for name in names]
    assert list(rows[0]) == ["step", *columns, "log_probability"]
    for row, z, log_p in zip(rows, noise.z, noise.log_probability_per_step, strict=True):
        assert [float(row[f"{name}_z"]) for name in names] == z.tolist()
        assert float(row["log_probability"]) == log_p


def test_steps_without_a_scene_are_the_noise_alone(http, campaign, deliver, result):
    deliver(campaign, result(0))
    rows = [
        *csv.DictReader(
            io.StringIO(http.get(f"/api/v1/campaigns/{campaign}/episodes/0/steps").text)
        )
    ]
    assert len(rows) == 4
    assert "ego_x_m" not in rows[0]
