"""Texts to be copied: each is run as it stands, against a service that listens."""

import contextlib
import io
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import deadlines
import msgspec
import pytest

from eigenfail.values import CampaignSpec
from eigenfail.values.access import KeyRequest, Scope
from eigenfail_api.__main__ import Server, listen
from eigenfail_api.app import create_app
from eigenfail_api.dashboard.copying import WORDS, CopiedRequest, Service, make_copies, to_toml
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key

BIN = str(Path(sys.executable).parent)

NASTY = 'it\'s $HOME `x` "q" \\ σ 🚚 {x} <b> TOML'
BODY = {
    "name": NASTY,
    "method": "cem",
    "episodes": 10,
    "seed": 3,
    "simulator": "point_mass",
    "planner": "idm",
    "settings": {"batch": 5, "min_std": 0.9},
    "scenario_parameters": {
        "distance_m": {"uniform": [53, 60.5]},
        "lane_change_s": {"choice": [2.8, 3.0]},
    },
    "stop": {"cost_usd": 1e-05},
}


@pytest.fixture
def address(store):
    """A service on a free port of this machine."""
    listener = listen("127.0.0.1", 0)
    server = Server(create_app(store, ApiSettings(port=0)))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    server.handle_exit(0, None)
    thread.join(timeout=deadlines.PROCESS_S)


def in_shell(text, folder):
    """What a shell makes of it."""
    path = f"{BIN}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["/bin/sh", "-ec", text],
        cwd=folder,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=deadlines.PROCESS_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def in_python(text, _folder):
    """What it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(text, {})  # that is what the text is for
    return printed.getvalue()


WAYS = {"curl": in_shell, "Python": in_python, "CLI": in_shell}


@pytest.mark.parametrize("way", WAYS)
def test_each_text_launches_the_campaign_that_the_form_launches(address, store, tmp_path, way):
    if way == "curl" and shutil.which("curl") is None:
        pytest.skip("there is no curl here")
    found = make_copies(
        Service(address), CopiedRequest(method="POST", path="/campaigns", body=BODY)
    )
    WAYS[way](dict(found.texts)[way], tmp_path)
    (campaign,) = store.campaigns.page(10).items
    assert campaign.spec == msgspec.convert(BODY, CampaignSpec)


@pytest.fixture
def pair(store, deliver, result):
    """Two campaigns of a suite, the first with an episode."""
    spec = msgspec.convert({**BODY, "name": "nightly one: a/b 'c'"}, CampaignSpec)
    one, other = (store.campaigns.create(spec).id for _ in range(2))
    deliver(one, result(0))
    return one, other


@pytest.mark.parametrize("way", WAYS)
def test_each_text_of_each_view_gets_what_it_shows(address, pair, tmp_path, way):
    one, other = pair
    paths = {
        "/campaigns": "nightly one",
        f"/campaigns/{one}": "nightly one",
        f"/campaigns/{one}/episodes": "safe",
        f"/campaigns/{one}/episodes/0": "safe",
        "/suites": "nightly one",
        "/suites/nightly%20one": "a/b",
    }
    if way == "curl" and shutil.which("curl") is None:
        pytest.skip("there is no curl here")
    for path, words in paths.items():
        text = dict(make_copies(Service(address), CopiedRequest(method="GET", path=path)).texts)[
            way
        ]
        assert words in WAYS[way](text, tmp_path), text
    query = {"a": str(one), "b": str(other)}
    compared = make_copies(
        Service(address), CopiedRequest(method="GET", path="/comparisons", query=query)
    )
    assert "completed" in WAYS[way](dict(compared.texts)[way], tmp_path)


def test_an_analysis_can_be_asked_for(address, finished, campaign, tmp_path):
    found = make_copies(
        Service(address), CopiedRequest(method="GET", path=f"/analyses/{finished()}")
    )
    assert found.cli == ""
    assert "explained" in in_python(found.python, tmp_path)


def test_names_of_suites_cannot_break_out(tmp_path):
    found = make_copies(
        Service("http://h"), CopiedRequest(method="GET", path="/suites/x'%3B%20touch%20y%20%23")
    )
    assert "touch%20y" in found.curl
    assert found.cli.startswith("eigenfail suite show 'x'\"'\"'; touch y #' --url")
    compile(found.python, "copy", "exec")


def test_what_toml_cannot_say_has_no_text_for_the_command_line():
    body = {**BODY, "settings": {"converged_share": None}}
    found = make_copies(
        Service("http://h"), CopiedRequest(method="POST", path="/campaigns", body=body)
    )
    assert [name for name, _ in found.texts] == ["curl", "Python"]


def test_every_kind_of_request_has_words_in_python():
    assert all(words.python.count("client.") == 1 for words in WORDS.values())


def test_keys_of_toml_are_quoted_where_needed():
    assert to_toml({"a b": 1, "c": True}) == '"a b" = 1\nc = true\n'


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("campaign", "/campaigns/1"),
        ("episode", "/campaigns/1/episodes/0"),
        ("suite", "/suites/x"),
        ("unknown", "/nonsense"),
        ("unknown_id", "/campaigns/x"),
    ],
)
def test_a_page_asks_for_its_texts(check_page, name, path):
    status = 404 if name.startswith("unknown") else 200
    check_page(f"dashboard/copies/{name}", f"/copies?path={path}", status=status)


@pytest.mark.parametrize("way", WAYS)
def test_each_text_shows_the_key_that_lies_in_the_environment(
    address, store, tmp_path, monkeypatch, way
):
    if way == "curl" and shutil.which("curl") is None:
        pytest.skip("there is no curl here")
    admin = make_key(store, KeyRequest("ada", Scope.ADMIN))
    monkeypatch.setenv("EIGENFAIL_KEY", admin.token)
    body = {"name": "ci's", "scope": "runner"}
    found = make_copies(
        Service(address, asks_for_key=True), CopiedRequest(method="POST", path="/keys", body=body)
    )
    assert admin.token not in str(found)
    WAYS[way](dict(found.texts)[way], tmp_path)
    assert [key.name for key in store.keys.page(10).items] == ["ci's", "ada"]
