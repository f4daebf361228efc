"""Signatures of webhooks, by the published example and by what must not pass."""

from base64 import b64decode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.values.access import redact
from eigenfail_webhooks.signatures import make_secret, sign_message, verify_message
from eigenfail_webhooks.values import NewWebhook, Webhook

# The example of the specification's reference libraries.
SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
ID, AT_S, BODY = "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, b'{"test": 2432232314}'
SIGNATURE = "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def headers(**changes):
    given = {"id": ID, "timestamp": str(AT_S), "signature": SIGNATURE} | changes
    return {f"webhook-{name}": value for name, value in given.items()}


def test_the_published_example_is_signed_alike():
    assert sign_message(SECRET, ID, AT_S, BODY) == SIGNATURE
    verify_message(SECRET, headers(), BODY, AT_S)


@pytest.mark.parametrize("age_s", [-300.0, 300.0])
def test_a_message_is_taken_within_five_minutes(age_s):
    verify_message(SECRET, headers(), BODY, AT_S + age_s)
    with pytest.raises(InvalidValue):
        verify_message(SECRET, headers(), BODY, AT_S + 1.01 * age_s)


def test_one_of_several_signatures_is_enough():
    both = f"v1,{'A' * 43}= v1a,xyz {SIGNATURE}"
    verify_message(SECRET, headers(signature=both), BODY, AT_S)


@pytest.mark.parametrize(
    "changes",
    [
        {"signature": ""},
        {"signature": SIGNATURE.removeprefix("v1,")},
        {"signature": SIGNATURE.replace("v1", "v2")},
        {"signature": "v1,ä"},
        {"id": "msg_other"},
        {"id": ""},
        {"timestamp": str(AT_S + 1)},
        {"timestamp": f"{AT_S}.0"},
        {"timestamp": "٣"},
        {"timestamp": "9" * 5_000},
    ],
)
def test_altered_headers_are_refused(changes):
    with pytest.raises(InvalidValue):
        verify_message(SECRET, headers(**changes), BODY, AT_S)


@given(st.binary(max_size=200), st.integers(0, 10**4), st.integers(0, 7))
def test_a_body_with_one_bit_changed_is_refused(body, place, bit):
    signed = headers(signature=sign_message(SECRET, ID, AT_S, body))
    verify_message(SECRET, signed, body, AT_S)
    changed = bytearray(body + b"\0")
    changed[place % len(changed)] ^= 1 << bit
    with pytest.raises(InvalidValue):
        verify_message(SECRET, signed, bytes(changed), AT_S)


def test_secrets_are_long_and_differ():
    made = {make_secret() for _ in range(20)}
    assert len(made) == 20
    assert all(len(b64decode(each.removeprefix("whsec_"), validate=True)) == 32 for each in made)


@pytest.mark.parametrize("secret", ["", "whsec_", "whsec_***", "whsec_MfKQ9r8"])
def test_a_secret_of_another_form_is_refused_and_not_repeated(secret):
    with pytest.raises(InvalidValue) as caught:
        sign_message(secret, ID, AT_S, BODY)
    key = secret.removeprefix("whsec_")
    assert not key or key not in str(caught.value)


def test_a_new_webhook_is_printed_without_its_secret():
    secret = make_secret()
    made = NewWebhook(Webhook(1, "https://hooks.example", (), True, 0), secret)
    assert secret not in repr(made)
    assert secret not in repr(made.__rich_repr__())
    assert redact(f"secret={secret};") == "secret=whsec_…;"
