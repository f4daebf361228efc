"""Commands to be copied: each is run as it stands, against a service that listens."""

import shutil
import subprocess

import deadlines
import msgspec
import pytest
from accepted import accept_spec
from served import serve

from eigenfail.values.access import KeyRequest, Scope
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_api.app import create_app
from eigenfail_api.dashboard.copying import Service, format_curl
from eigenfail_api.settings import ApiSettings
from eigenfail_services.access import make_key

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
    with serve(create_app(store, ApiSettings(port=0))) as port:
        yield f"http://127.0.0.1:{port}"


def in_shell(text, folder):
    """What a shell makes of it."""
    if shutil.which("curl") is None:
        pytest.skip("there is no curl here")
    done = subprocess.run(
        ["/bin/sh", "-ec", text],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=deadlines.PROCESS_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_command_launches_the_campaign_that_the_form_launches(address, store, tmp_path):
    in_shell(format_curl(Service(address), "/campaigns", BODY), tmp_path)
    (campaign,) = store.campaigns.page(10).items
    assert campaign.spec == msgspec.convert(BODY, CampaignSpec)


@pytest.fixture
def pair(store, deliver, result):
    """Two campaigns of a suite, the first with an episode."""
    spec = msgspec.convert({**BODY, "name": "nightly one: a/b 'c'"}, CampaignSpec)
    one, other = (store.campaigns.create(accept_spec(spec)).id for _ in range(2))
    deliver(one, result(0))
    return one, other


def test_the_command_of_each_view_gets_what_it_shows(address, pair, tmp_path):
    one, other = pair
    paths = {
        "/campaigns": "nightly one",
        f"/campaigns/{one}": "nightly one",
        f"/campaigns/{one}/episodes": "safe",
        f"/campaigns/{one}/episodes/0": "safe",
        "/suites": "nightly one",
        "/suites/nightly%20one": "a/b",
        f"/comparisons?a={one}&b={other}": "completed",
    }
    for path, words in paths.items():
        assert words in in_shell(format_curl(Service(address), path), tmp_path), path


def test_a_path_cannot_break_out(tmp_path):
    command = format_curl(Service("http://127.0.0.1:1"), "/suites/x';touch y #")
    in_shell(f"{command} || true", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("campaign", "/campaigns/1"),
        ("episode", "/campaigns/1/episodes/0"),
        ("suite", "/suites/x"),
        ("unknown", "nonsense"),
    ],
)
def test_a_page_asks_for_its_command(check_page, name, path):
    status = 404 if name.startswith("unknown") else 200
    check_page(f"dashboard/copies/{name}", f"/copies?path={path}", status=status)


def test_the_command_shows_the_key_that_lies_in_the_environment(
    address, store, tmp_path, monkeypatch
):
    admin = make_key(store, KeyRequest("ada", Scope.ADMIN))
    monkeypatch.setenv("EIGENFAIL_KEY", admin.token)
    body = {"name": "ci's", "scope": "runner"}
    command = format_curl(Service(address, asks_for_key=True), "/keys", body)
    assert admin.token not in command
    in_shell(command, tmp_path)
    assert [key.name for key in store.keys.page(10).items] == ["ci's", "ada"]
