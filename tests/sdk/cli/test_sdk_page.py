"""docs/sdk.md: what it shows runs, in the order in which it is read."""

import re
from pathlib import Path

import pytest

import eigenfail
from eigenfail.client import Client
from eigenfail.replays import run_once
from eigenfail.values.episode import EpisodeTask, TrajectorySource

PAGE = (Path(__file__).parents[3] / "docs" / "sdk.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def in_this_process(service, monkeypatch):
    """`eigenfail.local()` reaches a service without processes."""

    class Local:
        url = "http://127.0.0.1:8440"

        def __init__(self, **_given):
            pass

        def start(self):
            return Client(self.url, service)

    monkeypatch.setattr(eigenfail, "local", Local, raising=False)
    service.episodes_at_once = 64


def test_every_block_runs(in_this_process, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    seen = {}
    for block in BLOCKS:
        exec(compile(block, "docs/sdk.md", "exec"), seen)
    assert seen["campaign"].state == "done"
    assert len(seen["severities"]) == seen["summary"].counts.failures > 2
    assert seen["proof"].done
    changed, episode, spec = seen["changed"], seen["episode"], seen["campaign"].spec
    assert not changed.noise.z[:, 1].any()
    assert changed.digest() != episode.digest()
    task = EpisodeTask(episode.index, episode.seed, TrajectorySource(episode.noise.z))
    assert run_once(spec, task).digest() == episode.digest()
    assert "Did you mean 'idm'?" in capsys.readouterr().out


@pytest.mark.parametrize("resource", ["campaigns", "episodes", "analyses", "events"])
def test_the_verbs_on_the_page_exist(resource):
    client = Client()
    for verb in re.findall(rf"client\.{resource}\.(\w+)\(", PAGE):
        assert callable(getattr(getattr(client, resource), verb))
    table = PAGE.split("| `client.campaigns` | |")[1].split("\n\n")[0]
    for verb in re.findall(r"`(\w+)`", table):
        assert callable(getattr(client.campaigns, verb))
    client.close()
