"""The first administrator's key of a service that nobody sits before: in a file, and made once."""

import json
import stat
import subprocess
import sys

import pytest

from eigenfail.errors import InvalidValue
from eigenfail.values.access import TOKEN, KeyRequest, Scope
from eigenfail_services.access import authenticate_key, make_first_key, make_key
from eigenfail_services.store.clock import now_ms


def test_it_is_in_a_file_for_its_owner_alone_and_opens_the_door(store, tmp_path):
    file = tmp_path / "key"
    told = make_first_key(store, "compose", file)
    token = file.read_text().strip()
    assert authenticate_key(store, token, now_ms()) == told.made
    assert (told.made.scope, told.made.name) == (Scope.ADMIN, "compose")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert token not in repr(told)


def test_it_is_made_once_also_where_the_file_was_taken_away(store, tmp_path):
    file = tmp_path / "key"
    make_first_key(store, "compose", file)
    token = file.read_text()
    assert make_first_key(store, "compose", file).made is None
    assert file.read_text() == token
    file.unlink()
    assert make_first_key(store, "compose", file).made is None
    assert (file.exists(), store.keys.admins(now_ms())) == (False, 1)


def test_who_has_made_one_gets_no_other(store, tmp_path):
    make_key(store, KeyRequest("ada", Scope.ADMIN))
    assert make_first_key(store, "compose", tmp_path / "key").made is None
    assert not (tmp_path / "key").exists()


def test_one_that_broke_off_before_the_file_was_written_is_made_anew(store, tmp_path):
    make_key(store, KeyRequest("compose", Scope.ADMIN))
    (tmp_path / "key").write_text("\n")
    assert make_first_key(store, "compose", tmp_path / "key").made is not None
    assert TOKEN.fullmatch((tmp_path / "key").read_text().strip())


def test_no_key_is_made_that_could_not_be_kept(store, tmp_path):
    with pytest.raises(InvalidValue, match="cannot be written"):
        make_first_key(store, "compose", tmp_path / "nowhere" / "key")
    assert not store.keys.exist()


def test_the_program_says_nothing_of_the_secret(tmp_path):
    program = [sys.executable, "-m", "eigenfail"]
    place = ["--database", f"sqlite:///{tmp_path}/e.db"]
    subprocess.run([*program, "db", "upgrade", *place], check=True, capture_output=True)
    words = [*program, "key", "first", "compose", *place, "--json"]
    refused = subprocess.run(words, check=False, capture_output=True, text=True)
    assert (refused.returncode, "Traceback" in refused.stderr) == (2, False)
    words += ["--file", f"{tmp_path}/key"]
    said = [
        subprocess.run(words, check=True, capture_output=True, text=True).stdout for _ in range(2)
    ]
    assert [json.loads(each)["made"] is None for each in said] == [False, True]
    assert (tmp_path / "key").read_text().strip() not in said[0]


def test_a_file_that_cannot_be_looked_into_is_named_and_no_key_is_made(store, tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    (tmp_path / ".blocked.new").mkdir()
    for name in ("", "binary", "binary/key", "blocked"):
        with pytest.raises(InvalidValue) as refused:
            make_first_key(store, "compose", tmp_path / name)
        assert refused.value.field == "--file"
    assert not store.keys.exist()
