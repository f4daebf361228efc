"""Where `eigenfail run` runs: at the address asked for, on the folder's service, or on its own."""

from contextlib import contextmanager

import pytest
import typer
from msgspec.structs import replace
from typer.testing import CliRunner

from eigenfail.cli import connection, run
from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.cli.specs import read_spec
from eigenfail.client import Client
from eigenfail.errors import ServiceError, ServiceUnreachable, UnknownName
from eigenfail.hosting.folder import DEFAULT_DATA, DEFAULT_URL, Address, DataFolder
from eigenfail.hosting.service import Plan

OWN = Address("http://127.0.0.1:1", "tcp://127.0.0.1:2")


class Stub:
    """A service of our own that may find out that it is in trouble."""

    address = OWN
    trouble = None

    def check(self):
        if self.trouble:
            raise self.trouble


@pytest.fixture
def own(monkeypatch):
    stub = Stub()

    @contextmanager
    def started(plan):
        yield stub

    monkeypatch.setattr(connection, "local_service", started)
    return stub


@pytest.fixture
def somewhere(monkeypatch, spec_file, tmp_path):
    """Enters the place for a spec; only the `healthy` addresses answer."""
    context = typer.Context(typer.main.get_command(run.app))

    def enter(url=None, healthy=(), spec=None):
        monkeypatch.setattr(connection, "_is_healthy", lambda context, address: address in healthy)
        plan = Plan(tmp_path / "data", 0)
        return connection.open_place(context, spec or read_spec(spec_file), url, plan)

    return enter


def test_the_address_asked_for_comes_first(somewhere, own):
    with somewhere("http://there:1", {"http://there:1", DEFAULT_URL}) as place:
        assert place == connection.Place("http://there:1")


def test_nothing_is_started_if_nobody_is_where_it_was_asked_for(somewhere, own):
    with pytest.raises(ServiceUnreachable, match="http://there:1"):
        somewhere("http://there:1", {DEFAULT_URL}).__enter__()


def test_the_service_of_the_folder_comes_before_the_default_one(somewhere, own, tmp_path):
    folder = DataFolder(tmp_path / "data")
    theirs = Address("http://127.0.0.1:3", "tcp://127.0.0.1:4")
    with folder.claimed():
        folder.publish(theirs)
        with somewhere(healthy={theirs.url, DEFAULT_URL}) as place:
            assert place.url == theirs.url
    with somewhere(healthy={theirs.url, DEFAULT_URL}) as place:
        assert place.url == DEFAULT_URL


def test_otherwise_one_is_started_that_can_be_started_again(somewhere, own, tmp_path, monkeypatch):
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "a, b")
    with somewhere() as place:
        assert place.url == OWN.url
        assert place.again == f"eigenfail up --data {tmp_path / 'data'} --functions 'a, b'"
    monkeypatch.delenv("EIGENFAIL_FUNCTIONS")
    with somewhere() as place:
        assert place.again == f"eigenfail up --data {tmp_path / 'data'}"


def test_what_the_plug_ins_refuse_is_refused_before_one_is_started(somewhere, own, spec_file):
    spec_file.write_text(spec_file.read_text().replace("monte_carlo", "monte_calro"))
    with pytest.raises(UnknownName, match="Did you mean 'monte_carlo'"):
        somewhere(spec=read_spec(spec_file)).__enter__()


def test_an_own_service_that_falls_silent_says_why(somewhere, own):
    def fall_silent(trouble):
        own.trouble = trouble
        with somewhere():
            raise ServiceUnreachable("Nobody answers.")

    with pytest.raises(ServiceError, match="The controller process ended"):
        fall_silent(ServiceError("The controller process ended."))
    with pytest.raises(ServiceUnreachable, match=r"Nobody answers\."):
        fall_silent(None)


@pytest.fixture
def asked_of(service):
    """Runs a command; gives the address at which it looked for a service."""

    def run_command(*words):
        seen = []

        def connect(url):
            seen.append(url)
            return Client(DEFAULT_URL, service)

        words = ["campaign", "list", *words]
        done = CliRunner().invoke(app, words, obj=Environment(connect), prog_name="eigenfail")
        assert done.exit_code == 0, done.stderr
        return seen[-1]

    return run_command


def test_every_command_finds_the_service_of_the_folder(asked_of, monkeypatch, tmp_path):
    monkeypatch.setenv("EIGENFAIL_DATA", str(tmp_path / "data"))
    folder = DataFolder(tmp_path / "data")
    with folder.claimed():
        folder.publish(OWN)
        assert asked_of() == OWN.url
        assert asked_of("--url", "http://there:1") == "http://there:1"
        assert asked_of("--url", DEFAULT_URL) == DEFAULT_URL
        monkeypatch.setenv("EIGENFAIL_URL", "http://there:2")
        assert asked_of() == "http://there:2"


def test_a_folder_that_was_named_is_not_replaced_by_another(service, monkeypatch, tmp_path):
    monkeypatch.setenv("EIGENFAIL_DATA", str(tmp_path / "data"))
    monkeypatch.delenv("EIGENFAIL_URL", raising=False)

    def list_campaigns(*options):
        connect = Environment(lambda url: Client(DEFAULT_URL, service))
        return CliRunner().invoke(app, ["campaign", "list", *options], obj=connect)

    done = list_campaigns()
    assert done.exit_code == 3
    assert f"No service runs on {tmp_path / 'data'}" in done.stderr
    assert "eigenfail up" in done.stderr
    assert list_campaigns("--url", DEFAULT_URL).exit_code == 0


def test_the_usual_folder_is_the_one_in_which_up_works(asked_of, monkeypatch, tmp_path):
    monkeypatch.delenv("EIGENFAIL_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    folder = DataFolder(DEFAULT_DATA)
    with folder.claimed():
        folder.publish(OWN)
        assert asked_of() == OWN.url
    assert asked_of() == DEFAULT_URL


@pytest.mark.parametrize("simulator", ["bridge", "highway"])
def test_a_bridge_of_this_shell_is_not_that_of_a_service_that_runs(
    monkeypatch, capsys, spec_file, tmp_path, simulator
):
    @contextmanager
    def enter(*_given):
        yield connection.Place("http://there:1")

    monkeypatch.setattr(connection, "open_place", enter)
    monkeypatch.setattr(connection, "connect_to", enter)
    monkeypatch.setenv("EIGENFAIL_BRIDGE", "tcp://127.0.0.1:9")
    spec, plan = replace(read_spec(spec_file), simulator=simulator), Plan(tmp_path, 0)
    context = typer.Context(typer.main.get_command(run.app))
    with connection.connect_for_campaign(context, spec, None, plan):
        told = capsys.readouterr().err
    assert ("http://there:1 runs already" in told) is (simulator == "bridge")
