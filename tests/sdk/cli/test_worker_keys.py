"""`eigenfail worker key`: the commands, and what lies in the folder afterwards."""

import json
import os
import platform
from contextlib import closing
from pathlib import Path

import pytest

from eigenfail.errors import InvalidValue
from eigenfail.files import read_private
from eigenfail.hosting import service as local_service
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import Plan
from eigenfail.wire.keys import abbreviate_key, read_worker_key
from eigenfail_services import __main__ as services
from eigenfail_services.hub.key_commands import find_user
from eigenfail_services.hub.keys import HubKeys, KeyFolder, derive_public_key
from eigenfail_services.hub.transport import load_keys
from eigenfail_services.store.store import open_store


@pytest.fixture(autouse=True)
def at_hand(monkeypatch, tmp_path):
    """Commands run in a folder of the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("EIGENFAIL_DATABASE", raising=False)


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
    assert shown.hub == derive_public_key(here.secret) != derive_public_key(there.secret)
    assert here.list_accepted().get(derive_public_key(shown.secret)) == "here"
    assert there.list_accepted().get(derive_public_key(shown.secret)) is None


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
    assert (refused.exit_code, "is not a valid key name" in refused.stderr) == (2, True)
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
    monkeypatch.setattr(KeyFolder, "read_all", closed)
    refused = key("list")
    assert (refused.exit_code, "cannot be used: Permission denied" in refused.stderr) == (2, True)
    monkeypatch.setattr(KeyFolder, "secret", closed)
    with pytest.raises(InvalidValue, match="Permission denied"):
        load_keys("tcp://127.0.0.1:*", Path("eigenfail-data/hub-keys"))


def test_a_service_on_the_folder_asks_for_keys_once_there_are_some(key, tmp_path):
    plan = Plan(tmp_path / "eigenfail-data", 0)
    assert "--hub-keys" not in local_service.make_commands(plan, "", 1, 2)["services"]
    key("create", "crew")
    words = local_service.make_commands(plan, "", 1, 2)["services"]
    assert words[-2:] == ["--hub-keys", str(DataFolder(plan.data).hub_keys)]
    assert isinstance(services.parse(words[3:]).hub_keys, Path)


def test_a_hub_that_is_made_by_the_way_is_told_of(key):
    made = key("create", "crew")
    hub = HubKeys(KeyFolder(Path("eigenfail-data/hub-keys")))
    assert "had no key" in made.stderr
    assert abbreviate_key(derive_public_key(hub.secret)) in made.stderr
    assert key("create", "second").stderr == ""
    typo = key("create", "third", "--hub-keys", "eigenfail-data/hub-kyes")
    assert "a new one was made there" in typo.stderr


def test_a_key_that_ends_is_listed_with_its_end(key):
    assert ", until 20" in key("create", "crew", "--expires", "12h").stdout
    (listed,) = json.loads(key("list", "--json").stdout)
    assert round((listed["until_ms"] - listed["made_ms"]) / 1_000) == 12 * 3_600
    assert "valid" in key("list").stdout
    file = Path("eigenfail-data/hub-keys/workers/crew")
    public, made, _ = file.read_text().split()
    file.write_text(f"{public} {made} {made}\n")
    assert "expired" in key("list").stdout
    assert HubKeys(KeyFolder(Path("eigenfail-data/hub-keys"))).list_accepted() == {}
    wrong = key("create", "second", "--expires", "soon")
    assert (wrong.exit_code, "Write it like 90d" in wrong.stderr) == (2, True)


@pytest.mark.parametrize(
    ("line", "valid"),
    [("{}", True), ("{} 5 -", True), ("{} 5 9", False), ("{} x y", False), ("\n{}\n\n", True)],
)
def test_what_was_written_by_hand_is_read(key, line, valid):
    key("create", "crew")
    file = Path("eigenfail-data/hub-keys/workers/crew")
    public = file.read_text().split()[0]
    file.write_text(line.format(public))
    folder = KeyFolder(Path("eigenfail-data/hub-keys"))
    assert [each.name for each in folder.list()] == ["crew"]
    assert bool(list(folder.read_valid())) is valid


def test_a_key_is_renewed_at_once_or_with_a_time_for_both(key):
    key("create", "crew")
    first = secret_in("crew.key")
    hub = HubKeys(KeyFolder(Path("eigenfail-data/hub-keys")))
    refused = key("rotate", "crew")
    assert (refused.exit_code, "crew.key" in refused.stderr) == (2, True)
    assert list(hub.list_accepted().values()) == ["crew"]
    assert key("rotate", "crew", "--file", "2.key", "--keep-old", "1d").exit_code == 0
    assert hub.list_accepted().keys() == {
        derive_public_key(first.secret),
        derive_public_key(secret_in("2.key").secret),
    }
    assert len(json.loads(key("list", "--json").stdout)) == 2
    assert key("rotate", "crew", "--file", "3.key").exit_code == 0
    assert hub.list_accepted().keys() == {derive_public_key(secret_in("3.key").secret)}
    assert key("rotate", "nobody").exit_code == 2
    assert key("revoke", "crew").exit_code == 0
    assert hub.list_accepted() == {}


def test_a_hub_is_given_another_key_and_its_workers_follow(key):
    key("create", "crew")
    before = HubKeys(KeyFolder(Path("eigenfail-data/hub-keys")))
    made = key("rotate-hub")
    hub = HubKeys(KeyFolder(Path("eigenfail-data/hub-keys")))
    assert before.secret != hub.secret
    (word,) = (word for word in made.stdout.split() if word.startswith("efh_"))
    assert key("follow", "crew.key", word).exit_code == 0
    shown = secret_in("crew.key")
    assert shown.hub == derive_public_key(hub.secret)
    assert hub.list_accepted()[derive_public_key(shown.secret)] == "crew"
    assert Path("crew.key").stat().st_mode & 0o777 == 0o600
    for wrong in ("efh_short", word[4:], shown.text()):
        refused = key("follow", "--", "crew.key", wrong)
        assert (refused.exit_code, "is not the public key of a hub" in refused.stderr) == (2, True)
    assert key("rotate-hub", "--hub-keys", "nowhere").exit_code == 2
    assert not Path("nowhere").exists()


def test_changes_are_in_the_audit_log_of_the_folders_database(key, tmp_path):
    folder = DataFolder(tmp_path / "eigenfail-data")
    with closing(open_store(folder.database)) as store:
        key("create", "crew")
        assert key("create", "crew").exit_code == 0  # it is there already
        key("rotate", "crew", "--file", "2.key")
        key("list")
        key("rotate-hub")
        key("revoke", "crew")
        key("revoke", "crew")
        told = [(each.method, each.subject) for each in store.audit.page(9).items]
        (line, *_) = store.audit.page(1).items
    assert told[::-1] == [
        ("POST", "/worker-keys/crew"),
        ("POST", "/worker-keys/crew"),
        ("POST", "/hub-key"),
        ("DELETE", "/worker-keys/crew"),
    ]
    assert (line.who, line.key, line.address, line.status) == (
        find_user(),
        None,
        platform.node(),
        200,
    )


def test_without_its_database_a_key_is_made_all_the_same_and_the_log_says_so(key, monkeypatch):
    monkeypatch.setenv("EIGENFAIL_DATABASE", "sqlite:///nowhere/a.db")
    made = key("create", "crew")
    assert made.exit_code == 0
    assert "The change of /worker-keys/crew is not in the audit log: " in made.stderr
    assert not Path("nowhere").exists()
