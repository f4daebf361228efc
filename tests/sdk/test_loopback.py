"""One rule for what only this machine can reach, and who goes by it."""

import socket

import pytest

from eigenfail import bridges
from eigenfail.addresses import is_loopback, is_own_endpoint
from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail_api.settings import ApiSettings
from eigenfail_services.hub.transport import load_keys
from eigenfail_services.observability import split_address

OURS = ("127.0.0.1", "127.9.8.7", "localhost", "LOCALHOST", "[::1]")
OTHERS = (
    *("0.0.0.0", "10.0.0.1", "[::]", "[fe80::1]", "[::ffff:10.0.0.1]", "*", "lo", "127.1"),
    *("127.example.org", "127.0.0.1.example.org", "localhost.example.org", "127.0.0.256"),
)


def passes(check, *words) -> bool:
    """Whether nobody has to vouch for an address."""
    try:
        check(*words)
    except InvalidValue:
        return False
    return True


@pytest.mark.parametrize("host", [*OURS, *OTHERS])
def test_hub_bridge_figures_and_api_agree(host, monkeypatch) -> None:
    monkeypatch.delenv("EIGENFAIL_TRUST_NETWORK", raising=False)
    ours = host in OURS
    assert is_loopback(host) == ours
    assert is_own_endpoint(f"tcp://{host}:5555") == ours
    assert passes(load_keys, f"tcp://{host}:5555", None) == ours
    assert passes(load_keys, f"tcp://{host}:*", None) == ours
    assert passes(bridges.check_address, f"tcp://{host}:5555") == ours
    assert passes(split_address, f"{host}:5555") == ours
    assert ApiSettings(host=host).is_private == ours


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]"])
def test_no_proxy_lies_on_the_way_to_this_machine(host, monkeypatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as proxy:
        monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{proxy.getsockname()[1]}")
        with Client(f"http://{host}:1") as client:
            assert not client.health()
        proxy.setblocking(False)
        with pytest.raises(BlockingIOError):
            proxy.accept()


def test_pipes_are_of_this_machine_and_what_cannot_be_read_is_not() -> None:
    assert is_own_endpoint("ipc:///run/eigenfail.hub")
    for address in (
        "",
        "tcp://",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:1;10.0.0.1:2",
        "tcp://a@[::1]:1",
    ):
        assert not is_own_endpoint(address)
