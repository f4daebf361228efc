"""`eigenfail worker key`: the commands, and what lies in the folder afterwards."""

import json
import os
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from eigenfail.errors import EigenfailError, InputError, InvalidValue
from eigenfail.hosting import service as local_service
from eigenfail.hosting import worker_keys
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import Plan
from eigenfail.private_files import read_private
from eigenfail.wire.curve import read_worker_key
from eigenfail_services import __main__ as services
from eigenfail_services.hub.binding import keys_for
from eigenfail_services.hub.keys import HubKeys, KeyFolder, public_of


@pytest.fixture(autouse=True)
def at_hand(monkeypatch, tmp_path):
    """The services' program runs in this process, in a folder of the test."""

    def program(words):
        arguments = services.parse([*words])
        with redirect_stdout(StringIO()) as said:
            try:
                arguments.command(arguments)
            except EigenfailError as error:
                raise InputError("", str(error)) from None
        return said.getvalue()

    monkeypatch.setattr(worker_keys, "services_program", program)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def key(eigenfail):
    def run(*words):
        return eigenfail("worker", "key", *words)

    return run


def secret_in(file):
    return read_worker_key(read_private(Path(file), ""), "")


def test_a_key_is_made_listed_and_revoked(key):
    made = key("create", "crew")
    assert made.exit_code == 0, made.output
    assert "eigenfail worker --connect tcp://HOST:PORT --key-file crew.key" in made.stdout
    assert secret_in("crew.key").text() not in made.output
    assert key("create", "second", "--file", "b.key", "--json").exit_code == 0
    listed = json.loads(key("list", "--json").stdout)
    assert [each["name"] for each in listed] == ["crew", "second"]
    assert listed[0]["key"] in key("list").stdout
    assert listed[0]["key"] in key("revoke", "crew").stdout
    assert [each["name"] for each in json.loads(key("list", "--json").stdout)] == ["second"]
    again = key("revoke", "crew")
    assert (again.exit_code, "There are: second" in again.stderr) == (2, True)


def test_what_is_made_opens_the_hub_of_its_folder_alone(key):
    key("create", "here")
    key("create", "there", "--hub-keys", "other")
    here = HubKeys(KeyFolder(Path("eigenfail-data/hub-keys")))
    there = HubKeys(KeyFolder(Path("other")))
    shown = secret_in("here.key")
    assert shown.hub == public_of(here.secret) != public_of(there.secret)
    assert here.name_of(public_of(shown.secret)) == "here"
    assert there.name_of(public_of(shown.secret)) is None


def test_files_are_their_owners_alone(key):
    before = os.umask(0)
    try:
        key("create", "crew")
    finally:
        os.umask(before)
    folder = Path("eigenfail-data/hub-keys")
    modes = {path.name: path.stat().st_mode & 0o777 for path in [folder, *folder.rglob("*")]}
    assert modes == {"hub-keys": 0o700, "hub.key": 0o600, "workers": 0o700, "crew": 0o600}
    assert Path("crew.key").stat().st_mode & 0o777 == 0o600
    assert secret_in("crew.key").text() not in "".join(
        path.read_text() for path in folder.rglob("*") if path.is_file()
    )


def test_asking_again_for_what_was_made_changes_nothing(key):
    key("create", "crew")
    before = Path("crew.key").read_text()
    assert key("create", "crew").exit_code == 0
    assert Path("crew.key").read_text() == before
    assert key("create", "crew", "--file", "other.key").exit_code == 2
    assert not Path("other.key").exists()


def test_nothing_is_written_over(key):
    Path("crew.key").write_text("mine")
    refused = key("create", "crew")
    assert (refused.exit_code, "crew.key" in refused.stderr) == (2, True)
    assert Path("crew.key").read_text() == "mine"
    assert json.loads(key("list", "--json").stdout) == []


@pytest.mark.parametrize("name", ["../out", ".hidden", "a/b", "", "x" * 65, "a b"])
def test_a_name_that_is_no_file_in_the_folder_is_refused(key, name):
    refused = key("create", "--file=w.key", "--", name)
    assert (refused.exit_code, "is no name of a key" in refused.stderr) == (2, True)
    assert key("revoke", "--", name).exit_code == 2


def test_a_hub_key_that_everybody_reads_is_refused(key):
    key("create", "crew")
    Path("eigenfail-data/hub-keys/hub.key").chmod(0o644)
    refused = key("create", "second")
    assert (refused.exit_code, "chmod 600" in refused.stderr) == (2, True)


def test_a_folder_that_is_closed_to_us_is_said_in_a_sentence(key, monkeypatch):
    def closed(_folder):
        raise PermissionError(13, "Permission denied")

    key("create", "crew")
    monkeypatch.setattr(KeyFolder, "allowed", closed)
    refused = key("list")
    assert (refused.exit_code, "cannot be used: Permission denied" in refused.stderr) == (2, True)
    monkeypatch.setattr(KeyFolder, "secret", closed)
    with pytest.raises(InvalidValue, match="Permission denied"):
        keys_for("tcp://127.0.0.1:*", Path("eigenfail-data/hub-keys"))


def test_a_service_on_the_folder_asks_for_keys_once_there_are_some(key, tmp_path):
    plan = Plan(tmp_path / "eigenfail-data", 0)
    assert "--hub-keys" not in local_service.commands(plan, "", 1, 2)["services"]
    key("create", "crew")
    words = local_service.commands(plan, "", 1, 2)["services"]
    assert words[-2:] == ["--hub-keys", str(DataFolder(plan.data).hub_keys)]
    assert isinstance(services.parse(words[3:]).hub_keys, Path)
