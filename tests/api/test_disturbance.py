"""A disturbance model from the request to the stored noise, the client and the pages."""

from html import unescape

import msgspec
import numpy as np
import pytest
from tests.support.chart_tables import read_rows

from eigenfail.client import Client
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.shapes import Correlated, HeavyTailed
from eigenfail_api.dashboard.scene import make_noise_chart

URL = "/api/v1/campaigns"
MODEL = DisturbanceModel(scale=1.5, shape=Correlated(0.75, 0.25))


@pytest.fixture
def correlated(http, fields):
    """The id of a campaign whose noise is correlated."""
    body = fields | {"disturbance": msgspec.to_builtins(MODEL)}
    return http.post(URL, json=body).json()["id"]


@pytest.fixture
def noisy(result):
    """A collision of that campaign."""
    crash = result(1, Outcome.COLLISION)
    noise = msgspec.structs.replace(crash.noise, shape=MODEL.shape)
    return msgspec.structs.replace(crash, noise=noise)


def test_a_campaign_keeps_its_model(http, correlated, store):
    assert store.campaigns.get(correlated).spec.disturbance == MODEL
    told = http.get(f"{URL}/{correlated}").json()["spec"]["disturbance"]
    assert told["scale"] == 1.5
    assert told["shape"] == {
        "kind": "ar1",
        "longitudinal_correlation": 0.75,
        "lateral_correlation": 0.25,
    }


def test_noise_is_told_with_its_shape(http, correlated, deliver, noisy):
    deliver(correlated, noisy)
    told = http.get(f"{URL}/{correlated}/episodes/1").json()["noise"]
    assert told["shape"]["kind"] == "ar1"
    (row,) = http.get(f"{URL}/{correlated}/episodes").json()["items"]
    assert row["log_probability"] == pytest.approx(noisy.noise.log_probability)


def test_the_client_reads_metres_and_log_p_as_they_were(*, http, correlated, deliver, noisy):
    deliver(correlated, noisy)
    with Client("http://127.0.0.1:8440", transport=http._transport) as client:
        told = client.episodes.get(correlated, 1).noise
        heavy = client.campaigns.create(
            name="heavy",
            method="monte_carlo",
            episodes=1,
            disturbance=DisturbanceModel(shape=HeavyTailed(3.0)),
        )
    assert told.shape == MODEL.shape
    assert told.log_probability == noisy.noise.log_probability
    assert told.injected.tobytes() == noisy.noise.injected.tobytes()
    assert heavy.spec.disturbance.shape == HeavyTailed(3.0)


def test_the_pages_say_what_the_model_is(http, correlated, deliver, noisy):
    deliver(correlated, noisy)
    page = unescape(http.get(f"/campaigns/{correlated}").text)
    for words in MODEL.in_words().values():
        assert words in page
    assert MODEL.shape.in_words() in unescape(http.get(f"/campaigns/{correlated}/episodes/1").text)


def test_the_chart_shows_the_noise_and_not_the_draws_behind_it():
    z = np.array([[1.0, 2.0], [0.0, 0.0]], np.float32)
    chart = make_noise_chart(NoiseTrajectory(z, 2.0 * np.ones_like(z), Correlated(0.5, 0.25)), 0.1)
    assert chart.data["channels"]["longitudinal"].tolist() == [1.0, 0.5]
    assert chart.data["channels"]["lateral"].tolist() == [2.0, 0.5]
    assert read_rows(chart.table)[1][:5] == ("0.100", "0.500", "0.500", "1.00", "1.00")
