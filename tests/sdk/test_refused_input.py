"""What users write wrongly is refused with what was wrong and how it is written."""

import base64

import numpy as np
import pytest

from eigenfail.addresses import sqlite_path
from eigenfail.cli.analyze import read_variation
from eigenfail.cli.key import parse_duration
from eigenfail.cli.specs import parse_changes
from eigenfail.errors import InvalidValue, ProtocolError, UnknownName
from eigenfail.files import read_private
from eigenfail.values.access import Quotas
from eigenfail.values.arrays import PackedArray, decode_array, encode_array, pack, unpack
from eigenfail.values.campaign_spec import StopRules
from eigenfail.wire import keys
from eigenfail.wire.http import read_body, read_plain


def test_durations_of_keys_have_a_number_and_a_unit():
    assert (parse_duration("90d"), parse_duration("12h"), parse_duration("30m")) == (
        90 * 86_400,
        12 * 3_600,
        30 * 60,
    )
    for text in ("90", "d", "1.5h", "-1d", "90 d", ""):
        with pytest.raises(InvalidValue, match=r"not a valid duration.*90d, 12h or 30m"):
            parse_duration(text)


def test_changes_are_json_or_text():
    given = ("settings.alpha=100", "name=first try", "stop.failures=null", "settings.hold=[1, 2]")
    assert parse_changes(given) == {
        "settings": {"alpha": 100, "hold": [1, 2]},
        "name": "first try",
        "stop": {"failures": None},
    }
    for text in ("alpha", "=1", "settings..alpha=1"):
        with pytest.raises(InvalidValue, match=r"is not of the form FIELD=VALUE.*alpha=100"):
            parse_changes([text])


def test_variations_are_written_as_in_a_campaigns_file():
    assert read_variation("distance_m = 53.0, ego_speed_mps = 23.0") == {
        "distance_m": 53.0,
        "ego_speed_mps": 23.0,
    }
    with pytest.raises(InvalidValue, match=r"'distance 53' cannot be read.*--variation"):
        read_variation("distance 53")


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("mysql:///a", "cannot be read"),
        ("sqlite://host/a", "cannot be read"),
        ("sqlite:///a.db?mode=ro", "has a '[?]'.*%3F"),
        ("sqlite:///", "does not contain a file name"),
        ("sqlite:///:memory:", "does not contain a file name"),
        ("sqlite:///a%00b", "does not contain a file name"),
    ],
)
def test_an_address_that_names_no_file_is_refused(url, words):
    with pytest.raises(InvalidValue, match=words):
        sqlite_path(url)


def test_bodies_that_are_no_json_are_refused_apart_from_those_of_another_kind():
    assert read_body(b"", StopRules) == StopRules()
    assert read_plain(b"", dict) == {}
    for read, kind in ((read_body, StopRules), (read_plain, dict)):
        with pytest.raises(ProtocolError, match=r"The body is not JSON.*Send"):
            read(b"{", kind)
    with pytest.raises(UnknownName, match="failuers"):
        read_body(b'{"failuers": 3}', StopRules)
    with pytest.raises(InvalidValue, match="failures"):
        read_body(b'{"failures": "three"}', StopRules)
    with pytest.raises(InvalidValue):
        read_plain(b"[]", dict)
    assert read_body(b'{"max_open": 3}', Quotas).max_open == 3


def test_a_private_file_is_read_only_if_others_cannot(tmp_path):
    file = tmp_path / "key"
    file.write_text(" secret\n")
    file.chmod(0o600)
    assert read_private(file, "key") == "secret"
    file.chmod(0o644)
    with pytest.raises(InvalidValue, match=r"\(mode 644\).*chmod 600"):
        read_private(file, "key")
    with pytest.raises(InvalidValue, match="cannot be read: No such file or directory"):
        read_private(tmp_path / "none", "key")
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidValue, match="it is not a text file"):
        read_private(file, "key")


def test_arrays_travel_as_float32_of_a_shape_that_fits():
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert np.array_equal(unpack(pack(array)), array)
    assert np.array_equal(decode_array(None, [[1.0, 2.0]]), np.array([[1.0, 2.0]], np.float32))
    with pytest.raises(ProtocolError, match="Arrays travel as float32, not float64"):
        pack(array.astype(np.float64))
    for shape in ((-1,), (2, -1), (1,) * 5, (10**9,), (0, 10**9)):
        with pytest.raises(ProtocolError, match="outside what may travel"):
            unpack(PackedArray(shape, b""))
    with pytest.raises(ProtocolError, match="does not fit 4 bytes"):
        unpack(PackedArray((2,), b"1234"))
    with pytest.raises(TypeError, match="set does not travel"):
        encode_array(set())


def test_keys_of_workers_and_hubs_are_told_apart():
    hub, secret = bytes(range(32)), bytes(range(32, 64))
    key = keys.WorkerKey(hub, secret)
    assert keys.read_worker_key(key.text(), "key") == key
    assert "secret" not in repr(key)
    assert keys.read_worker_key(key.following(secret).text(), "key").hub == secret
    assert keys.read_hub_key(keys.format_hub_key(hub), "hub") == hub
    assert keys.abbreviate_key(hub) == "000102030405"
    for text in ("", "ewk", key.text()[:-4], keys.format_hub_key(hub)):
        with pytest.raises(InvalidValue, match=r"is not a worker key.*worker key create"):
            keys.read_worker_key(text, "key")
    for text in ("", key.text(), keys.format_hub_key(hub)[:-4]):
        with pytest.raises(InvalidValue, match=r"not the public key of a hub.*rotate-hub"):
            keys.read_hub_key(text, "hub")
    assert keys.decode_key(base64.urlsafe_b64encode(hub).decode().rstrip("="), 32) == hub
    assert keys.decode_key("!!", 32) is None
