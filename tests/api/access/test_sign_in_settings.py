"""Settings that are refused are named, with what is wrong, in plain words."""

import pytest

from eigenfail.errors import InvalidValue
from eigenfail_api.__main__ import read_settings

REFUSED = [
    ("SIGN_IN_PROXIES", '["garbage"]', "'garbage' is not a network such as 10.0.0.5/32."),
    ("SIGN_IN_PROXIES", '["10.0.0.5/33"]', "'10.0.0.5/33' is not a network"),
    ("SIGN_IN_PROXIES", '["fd00::/200"]', "'fd00::/200' is not a network"),
    ("SIGN_IN_PROXIES", '"10.0.0.5/32"', "'10.0.0.5/32' is not a list."),
    ("SIGN_IN_SCOPES", '{"*": "king"}', "'king' is not one of 'viewer', 'runner' or 'admin'."),
    ("SIGN_IN_SCOPES", "[1]", "is not an object of names and values."),
    ("SIGN_IN_USER_HEADER", "a b", "'a b' is not in the expected format."),
    ("HOSTS", "[3]", "3 is not text."),
    ("PORT", "abc", "'abc' is not an integer."),
    ("MAX_CONNECTIONS", "3", "3 is below 10."),
    ("REQUIRE_KEYS", "maybe", "'maybe' is neither true nor false."),
]


@pytest.mark.parametrize(("name", "value", "words"), REFUSED)
def test_refused_setting_is_named_in_plain_words(monkeypatch, name, value, words):
    monkeypatch.setenv(f"EIGENFAIL_{name}", value)
    with pytest.raises(InvalidValue) as raised:
        read_settings([])
    told = str(raised.value)
    assert raised.value.field == name.lower()
    assert words in told
    assert f"EIGENFAIL_{name}" in told
    assert "lax-or-strict" not in told
    assert "Input" not in told
