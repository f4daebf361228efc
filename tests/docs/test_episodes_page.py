"""docs/episodes.md: its filters are read, its columns are those that there are, its code runs."""

import re
import shlex

import numpy as np
import pytest
from starlette.testclient import TestClient

import eigenfail.client
from eigenfail.cli import main
from eigenfail.errors import UnknownName
from eigenfail.filters import parse_fields, parse_filter, parse_sort
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import Measures
from eigenfail.values.records import Delivery
from eigenfail_api.app import create_app
from eigenfail_api.routes import episodes, recordings
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store import open_store
from eigenfail_services.store.listing import INDEXED


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs/episodes.md").read_text()


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)


def test_its_commands_can_be_given(page):
    import typer

    lines = "".join(blocks(page, "sh")).splitlines()
    assert len(lines) == 9
    for line in lines:
        words = shlex.split(line)[1:]
        command = typer.main.get_command(main.app)
        context = command.make_context("eigenfail", list(words))
        while rest := [*getattr(context, "_protected_args", []), *context.args]:
            name, command, rest = command.resolve_command(context, rest)
            context = command.make_context(name, rest, parent=context)
            command = context.command
        given = context.params
        parse_filter(given["conditions"])
        parse_sort(given["sort"])
        parse_fields(given["fields"])


def test_its_filters_are_read_and_its_refusal_is_the_one_that_comes(page):
    filters, refusal = blocks(page, "text")
    assert all(parse_filter(line) for line in filters.splitlines())
    with pytest.raises(UnknownName) as refused:
        parse_filter("sevrity > 80")
    assert str(refused.value).startswith(refusal.strip())


def test_what_it_says_of_indices_is_so(page):
    sentence = page.split("The database keeps")[1].split("sorted")[0]
    assert set(re.findall(r"`(\w+)`", sentence)) == INDEXED | {"index"}


def test_its_addresses_are_routes(page):
    told = re.findall(r"^\| `(\w+) (/api/v1/[^`]+)` \|", page, re.MULTILINE)
    there = (*episodes.router.routes, *recordings.router.routes)
    routes = {(method, route.path) for route in there for method in route.methods}
    # Other pages describe a single episode, its explanation and its replay.
    elsewhere = ("/{index}", "/explanation", "/replay", "/steps")
    assert set(told) == {each for each in routes if not each[1].endswith(elsewhere)}


def test_its_python_runs(page, tmp_path, monkeypatch, capsys):
    store = open_store("memory://")
    campaign = store.campaigns.create(
        CampaignSpec(name="example", method="monte_carlo", episodes=3)
    )
    store.campaigns.move(campaign.id, "running")
    results = [episode(0, Outcome.COLLISION, 9.0), episode(1, Outcome.SAFE, None)]
    store.episodes.commit(campaign.id, [Delivery(result, "w") for result in results])
    monkeypatch.chdir(tmp_path)
    app = create_app(store, ApiSettings(database=f"sqlite:///{tmp_path}/data/eigenfail.db"))
    real = eigenfail.client.Client
    with TestClient(app) as served:
        monkeypatch.setattr(eigenfail.client, "Client", lambda: real(transport=served._transport))
        (code,) = blocks(page, "python")
        exec(compile(code, "docs/episodes.md", "exec"), {})
    said = capsys.readouterr().out
    assert "0 9.0" in said
    assert "m²/s²" in said
    assert {"failures.csv", "all.parquet"} <= {path.name for path in tmp_path.iterdir()}
    store.close()


def episode(index, outcome, severity):
    z = np.ones((4, 2), np.float32)
    measures = Measures(0.0, severity=severity, min_ttc_s=1.0)
    return EpisodeResult(index, index, outcome, 4, NoiseTrajectory(z, z), "prior", measures)
