"""Where events may be sent: public addresses alone, whatever they are written like."""

import socket
from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network

import anyio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from structlog.testing import capture_logs

from eigenfail.errors import InvalidValue
from eigenfail_webhooks.addresses import (
    VARIABLE,
    AddressRefused,
    check_url,
    is_allowed,
    is_public,
    parse_networks,
    read_networks,
    resolve_host,
)

# Registries of special addresses (RFC 6890), written out by hand: the judge must not be judged by
# the library that it asks.
PRIVATE = (
    *("0.0.0.0/8", "10.0.0.0/8", "100.64.0.0/10", "127.0.0.0/8", "169.254.0.0/16"),
    *("172.16.0.0/12", "192.0.2.0/24", "192.168.0.0/16", "198.18.0.0/15", "198.51.100.0/24"),
    *("203.0.113.0/24", "224.0.0.0/4", "240.0.0.0/4"),
    *("168.63.129.16/32", "192.0.0.0/24", "192.88.99.0/24", "2001::/23", "3fff::/20"),
    *("::/96", "::1/128", "100::/64", "2001:db8::/32", "2001::/32", "2002::/16", "64:ff9b:1::/48"),
    *("fc00::/7", "fe80::/10", "fec0::/10", "ff00::/8", "4000::/3"),
)
PUBLIC = ("1.1.1.1", "8.8.8.8", "93.184.216.34", "2606:4700::1111", "2a00:1450:4001::1")
OWN = parse_networks("10.1.0.0/16, 192.168.2.7,fd00:1::/32")


def within(network):
    """Addresses of a network."""
    first, last = int(network[0]), int(network[-1])
    return st.integers(first, last).map(type(network[0]))


@given(st.sampled_from(PRIVATE).map(ip_network).flatmap(within))
def test_no_private_address_is_permitted(address):
    assert not is_public(address)


@given(st.sampled_from([each for each in PRIVATE if "." in each]).map(ip_network).flatmap(within))
def test_nor_behind_an_ipv6_address(address):
    for prefix in ("::ffff:0:0", "64:ff9b::", "::", "2002::"):
        shift = 80 if prefix == "2002::" else 0
        assert not is_public(IPv6Address(int(IPv6Address(prefix)) | int(address) << shift))


@pytest.mark.parametrize("address", PUBLIC)
def test_public_addresses_are_permitted(address):
    assert is_public(ip_address(address))
    if "." in address:
        assert is_public(IPv6Address(f"::ffff:{address}"))
        assert is_public(IPv6Address(f"64:ff9b::{address}"))


@given(st.integers(0, 2**32 - 1).map(IPv4Address))
def test_addresses_of_the_operators_networks_alone_are_allowed(address):
    in_own = any(address in network for network in OWN)
    assert is_allowed(address, OWN) == in_own
    assert is_allowed(IPv6Address(f"::ffff:{address}"), OWN) == in_own


def test_networks_are_read_from_a_list():
    assert [str(each) for each in OWN] == ["10.1.0.0/16", "192.168.2.7/32", "fd00:1::/32"]
    assert parse_networks(" , ") == ()
    for wrong in ("10.1.0.1/16", "localhost", "10.0.0.0/33"):
        with pytest.raises(ValueError, match=r"host bits|IPv4"):
            parse_networks(wrong)


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1", "127.1", "2130706433", "0x7f000001", "0x7f.1", "017700000001", "0", "localhost"],
)
def test_other_notations_of_this_machine_are_refused(host):
    with pytest.raises(AddressRefused, match="not a public address"):
        anyio.run(resolve_host, host, 80, ())
    assert anyio.run(resolve_host, "127.1", 80, parse_networks("127.0.0.0/8")) == "127.0.0.1"


def test_a_host_resolves_to_its_first_permitted_address(monkeypatch):
    found = ["10.1.2.3", "::ffff:10.0.0.1", "2606:4700::1111", "8.8.8.8"]
    answer = [(0, 0, 0, "", (each, 443)) for each in found]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: answer)
    assert anyio.run(resolve_host, "hooks.example", 443, ()) == "2606:4700::1111"
    assert anyio.run(resolve_host, "hooks.example", 443, OWN) == "10.1.2.3"


@pytest.mark.parametrize(
    ("port", "is_taken"),
    [(80, True), (443, True), (1024, True), (8443, True), (65535, True)]
    + [(port, False) for port in (1, 22, 25, 53, 81, 110, 442, 444, 587, 1023)],
)
def test_ports_of_other_protocols_are_for_the_networks_of_the_operator(port, is_taken):
    if is_taken:
        assert anyio.run(resolve_host, "8.8.8.8", port, ()) == "8.8.8.8"
    else:
        with pytest.raises(AddressRefused, match=rf"Port {port} of 8\.8\.8\.8 .*NETWORKS"):
            anyio.run(resolve_host, "8.8.8.8", port, ())
    assert anyio.run(resolve_host, "8.8.8.8", port, parse_networks("8.8.8.8")) == "8.8.8.8"
    assert anyio.run(resolve_host, "10.1.0.1", port, OWN) == "10.1.0.1"


def test_a_name_without_addresses_is_refused():
    with pytest.raises(AddressRefused, match="cannot be resolved"):
        anyio.run(resolve_host, "x" * 300, 80, ())


@pytest.mark.parametrize(
    "url",
    [
        *("https://", "https:///path", "ftp://host/", "//host", "https://host:0/", "https://h:x/"),
        *("https://host:99999/", "https://[::1/", "https://höst/", "https://host/a b"),
        *("https://host/\n", "https://host/\x00"),
    ],
)
def test_what_is_no_url_of_a_host_is_refused(url):
    with pytest.raises(InvalidValue):
        check_url(url)


@pytest.mark.parametrize("wrong", ["10.1.0.1/16", "10.1.0.0/16,everything"])
def test_networks_that_cannot_be_read_allow_nothing_and_are_logged(monkeypatch, wrong):
    monkeypatch.setenv(VARIABLE, "10.1.0.0/16,192.168.2.7")
    assert len(read_networks()) == 2
    monkeypatch.setenv(VARIABLE, wrong)
    with capture_logs() as logged:
        assert read_networks() == ()
    (line,) = logged
    assert VARIABLE in line["problem"]
    monkeypatch.delenv(VARIABLE)
    assert read_networks() == ()
