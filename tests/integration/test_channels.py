"""Functions that name the components of their noise, from the campaign to its figures."""

from statistics import NormalDist

import httpx2
import numpy as np
import pytest
from pyarrow import parquet
from short_searches import wait_until_done

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.episode import Outcome

pytestmark = pytest.mark.service

STEPS = 8
CHANNELS = ("gust", "drift", "bias")
P_FAIL = NormalDist().cdf(-2.0)
FUNCTION = {
    "simulator": "function",
    "scenario": "function",
    "planner": "eigenfail_planes:far",
    "seed": 11,
}
SEARCHES = {
    "monte_carlo": (400, {}),
    "held": (200, {}),
    "cem": (200, {}),
    "cma": (200, {}),
    "ast": (150, {}),
    "difs": (160, {}),
    "ensemble": (120, {"method": "cem", "members": 2}),
    "subset": (1_000, {}),
    "mixture": (1_000, {}),
}


def create(client, channels, method, episodes, settings, **fields):
    parameters = {"steps": STEPS, "channels": list(channels)}
    fields |= {"name": f"{method} on {len(channels)}", "method": method, "episodes": episodes}
    return client.campaigns.create(
        **FUNCTION, **fields, settings=settings, scenario_parameters=parameters
    )


def test_every_search_works_in_all_channels(client, lasting_worker) -> None:
    """The contract of learners, in every method's own tests, tries other numbers of channels."""
    channels = ("a", "b", "c", "d", "e")
    started = [create(client, channels, name, *given) for name, given in SEARCHES.items()]
    for campaign in started:
        ended = wait_until_done(client, campaign)
        rows = [*client.episodes.list(campaign.id)]
        assert ended.counts.errored == 0
        stored = client.episodes.get(campaign.id, rows[-1].index)
        assert stored.noise.z.shape == stored.noise.sigma.shape == (STEPS, len(channels))
        density = -0.5 * np.float64(stored.noise.z) ** 2 - 0.5 * np.log(2.0 * np.pi)
        assert rows[-1].log_probability == pytest.approx(density.sum(), rel=1e-6)
    told = set()
    for campaign in started:
        summary = client.campaigns.summary(campaign.id)
        assert summary.counts.failures
        if found := summary.estimate and summary.estimate.interval:
            told.add(campaign.spec.method)
            assert found.low <= P_FAIL <= found.high
    assert "subset" in told  # of 40 components `mixture` may refuse to tell


@pytest.fixture(scope="module")
def failing(service, lasting_worker):
    """A search in three channels that is done; no test changes it."""
    with Client(service.address.url) as client:
        return wait_until_done(client, create(client, CHANNELS, "cem", 300, {}))


def test_tables_of_noise_have_the_channels_of_the_campaign(client, failing, tmp_path) -> None:
    file = client.episodes.export(failing.id, tmp_path / "episodes.parquet", noise=True)
    table = parquet.read_table(file)
    names = [name for name in table.column_names if name.endswith("_z")]
    assert names == [f"{name}_z" for name in CHANNELS]
    stored = client.episodes.get(failing.id, table["index"][0].as_py())
    for name, column in zip(names, stored.noise.z.T, strict=True):
        assert table[name][0].as_py() == column.tolist()


def test_failures_are_grouped_in_all_channels_or_in_one(client, failing) -> None:
    joint = client.analyses.wait(client.analyses.create(failing.id).id)
    assert joint.state is AnalysisState.DONE, joint.problem
    assert joint.result.modes[0].eigenfailure.shape[1] == len(CHANNELS)
    alone = client.analyses.wait(client.analyses.create(failing.id, axes="bias").id)
    assert alone.state is AnalysisState.DONE, alone.problem
    assert not alone.result.components[:, :, :2].any()
    with pytest.raises((InvalidValue, UnknownName), match="drift"):
        client.analyses.create(failing.id, axes="drif")


def test_pages_name_the_channels(client, failing) -> None:
    analysis = client.analyses.wait(client.analyses.create(failing.id).id)
    index = next(iter(client.episodes.list(failing.id, outcome=Outcome.COLLISION))).index
    for path in (f"analyses/{analysis.id}", f"campaigns/{failing.id}/episodes/{index}"):
        page = httpx2.get(f"{client.url}/{path}").raise_for_status().text
        assert "drift" in page.lower()
        assert "lateral" not in page.lower()


def test_a_failure_is_replayed_and_shrunk(client, failing) -> None:
    index = next(iter(client.episodes.list(failing.id, outcome=Outcome.COLLISION))).index
    replayed = wait_until_done(client, client.episodes.replay(failing.id, index))
    assert replayed.counts.failures == 1
    shrunk = wait_until_done(client, client.campaigns.shrink(failing.id, index))
    minimal = client.campaigns.minimal(shrunk.id)
    assert minimal.because.startswith("No step of one channel can be left out.")
    assert minimal.words.startswith("Bias")
    assert "gust noise has no effect; drift noise has no effect" in minimal.words
