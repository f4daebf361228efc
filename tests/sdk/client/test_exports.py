"""Episodes written to files by the client, against the whole API."""

import json

import numpy as np
import pytest
from starlette.testclient import TestClient

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, NotFound, ServiceError, UnknownName
from eigenfail.values.campaign import CampaignState
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings


def read_parquet(path):
    from pyarrow.parquet import read_table

    return read_table(path)["index"].to_pylist()


READERS = {
    ".csv": lambda path: [int(line) for line in path.read_text().split()[1:]],
    ".ndjson": lambda path: [json.loads(line)["index"] for line in path.read_text().split()],
    ".parquet": read_parquet,
}


@pytest.fixture
def client(store, tmp_path_factory):
    """A client of a whole API whose files have a folder of their own."""
    folder = tmp_path_factory.mktemp("data")
    app = create_app(store, ApiSettings(database=f"sqlite:///{folder}/eigenfail.db"))
    with TestClient(app) as served, Client(transport=served._transport) as client:
        yield client


@pytest.fixture
def campaign(client, store, fields):
    """A campaign with two collisions, and a safe episode between them."""
    made = client.campaigns.create(**fields)
    store.campaigns.move(made.id, CampaignState.RUNNING)
    outcomes = (Outcome.COLLISION, Outcome.SAFE, Outcome.COLLISION)
    results = [episode(index, outcome) for index, outcome in enumerate(outcomes)]
    store.episodes.commit(made.id, [Delivery(result, "w") for result in results])
    return made


def episode(index, outcome):
    z = np.ones((4, 2), np.float32)
    noise = NoiseTrajectory(z, z)
    return EpisodeResult(index, index, outcome, 4, noise, "prior", Measures(0.0))


@pytest.mark.parametrize("name", ["found.csv", "found.ndjson", "found.parquet"])
def test_episodes_are_exported(client, campaign, tmp_path, name):
    path = tmp_path / name
    wanted = {"filter": "outcome = collision", "sort": "-index", "fields": ("index",)}
    assert client.episodes.export(campaign.id, path, **wanted) == path
    assert READERS[path.suffix](path) == [2, 0]
    assert list(tmp_path.iterdir()) == [path]


def test_an_export_that_cannot_be_leaves_no_file(client, campaign, tmp_path):
    old = tmp_path / "found.csv"
    old.write_text("old")
    with pytest.raises(InvalidValue, match="character 11"):
        client.episodes.export(campaign.id, old, filter="severity >")
    with pytest.raises(NotFound):
        client.episodes.export(99, old)
    with pytest.raises(UnknownName, match="parquet"):
        client.episodes.export(campaign.id, tmp_path / "found.xlsx")
    with pytest.raises(InvalidValue, match="csv holds no noise"):
        client.episodes.export(campaign.id, old, noise=True)
    with pytest.raises(UnknownName, match="Did you mean 'fields'"):
        client.episodes.export(campaign.id, old, field=("index",))
    with pytest.raises(ServiceError, match="cannot be written"):
        client.episodes.export(campaign.id, tmp_path / "none" / "found.csv")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]
