"""Addresses to which events may be sent: public ones, and those that the operator allows.

A webhook names a host, and a user who creates webhooks could make the service connect to hosts that
only the service reaches (server-side request forgery). So the resolved address is judged at each
attempt, and the connection is made to this address. A second resolution could give another address
(DNS rebinding).
"""

import ipaddress
import os
import socket
from collections.abc import Iterable, Sequence
from functools import partial
from urllib.parse import urlsplit

import structlog
from anyio import CapacityLimiter
from anyio.to_thread import run_sync

from eigenfail.errors import InvalidValue

VARIABLE = "EIGENFAIL_WEBHOOK_NETWORKS"
SCHEMES = frozenset({"http", "https"})

IpAddress = ipaddress.IPv4Address | ipaddress.IPv6Address
IpNetwork = ipaddress.IPv4Network | ipaddress.IPv6Network

GLOBAL_UNICAST = ipaddress.IPv6Network("2000::/3")
SIX_TO_FOUR = ipaddress.IPv6Network("2002::/16")
"""Leads to the IPv4 address in it, through relays that hardly exist any more."""

NAT64 = ipaddress.IPv6Network("64:ff9b::/96")
"""Leads to the IPv4 address in its last 32 bits, on networks without IPv4 (RFC 6052)."""


NOT_PUBLIC: tuple[IpNetwork, ...] = (
    ipaddress.IPv4Network("168.63.129.16/32"),  # services of the host of a virtual machine of Azure
    ipaddress.IPv4Network("192.0.0.0/24"),  # protocol assignments, and metadata of Oracle's cloud
    ipaddress.IPv4Network("192.88.99.0/24"),  # relays from 6to4 (RFC 7526)
    ipaddress.IPv6Network("2001::/23"),  # protocol assignments
    ipaddress.IPv6Network("3fff::/20"),  # documentation (RFC 9637)
)
"""Networks that are refused although some version of Python holds them to be public."""

WEB_PORTS = frozenset({80, 443})
FIRST_USER_PORT = 1024
"""First port for events except 80 and 443: lower ports are of other protocols, such as mail."""


log = structlog.get_logger()


class AddressRefused(Exception):
    """Events may not be sent to any address of a host."""


def read_networks() -> tuple[IpNetwork, ...]:
    """Return the private networks that the environment allows.

    If the list cannot be read, the log says so, and no private network is allowed.
    """
    try:
        return parse_networks(os.environ.get(VARIABLE, ""))
    except ValueError as error:
        remedy = "Give networks such as 10.1.0.0/16,192.168.2.7, and restart the services."
        problem = f"{VARIABLE}: {error}. {remedy}"
        log.warning("no private network is allowed", problem=problem)
        return ()


def parse_networks(text: str) -> tuple[IpNetwork, ...]:
    """Return the networks of a list with commas in between; none of an empty text.

    Raises:
        ValueError: something in it is not a network.
    """
    return tuple(ipaddress.ip_network(part.strip()) for part in text.split(",") if part.strip())


def check_url(url: str) -> None:
    """Check that a URL names a host and a port; the resolved address is judged at each attempt.

    Raises:
        InvalidValue: it does not, or it is not printable ASCII.
    """
    try:
        parts = urlsplit(url)
        is_complete = parts.scheme in SCHEMES and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_complete = False
    if not (is_complete and url.isascii() and url.isprintable() and " " not in url):
        problem = "it is not a valid URL of a host."
        raise InvalidValue("url", problem, "Write it like https://host.example/path, in ASCII.")


def is_allowed(address: IpAddress, allowed: Iterable[IpNetwork]) -> bool:
    """Return whether the operator allows an address, at any port.

    Args:
        address: an address to which a host's name was resolved.
        allowed: networks that are permitted although they are not public.
    """
    leads_to = _find_destination(address)
    return any(leads_to in network for network in allowed)


def is_public(address: IpAddress) -> bool:
    """Return whether an address is one of the public network."""
    leads_to = _find_destination(address)
    if any(leads_to in network for network in NOT_PUBLIC):
        return False
    if isinstance(leads_to, ipaddress.IPv6Address):
        is_unicast = leads_to in GLOBAL_UNICAST and leads_to not in SIX_TO_FOUR
        return is_unicast and leads_to.is_global
    return leads_to.is_global and not (leads_to.is_multicast or leads_to.is_reserved)


def is_web_port(port: int) -> bool:
    """Return whether events may be sent to a port of a public address: 80, 443, or from 1024 on."""
    return port in WEB_PORTS or port >= FIRST_USER_PORT


def _find_destination(address: IpAddress) -> IpAddress:
    """Return the IPv4 address that an IPv6 address embeds, or the address itself."""
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:
            return address.ipv4_mapped
        if address in NAT64:
            return ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)
    return address


async def resolve_host(host: str, port: int, allowed: Sequence[IpNetwork]) -> str:
    """Return the first address of a host to which events may be sent.

    Other notations of addresses, such as 2130706433 or 0x7f.1, are resolved like names.

    Raises:
        AddressRefused: no address is allowed at this port, or the name cannot be resolved.
    """
    resolve = partial(socket.getaddrinfo, host, port, type=socket.SOCK_STREAM)
    try:
        # A resolver that does not answer is left to itself when the attempt is over. It has a limit
        # of its own: all of the others would wait for names of which one hangs.
        found = await run_sync(resolve, abandon_on_cancel=True, limiter=CapacityLimiter(1))
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not a valid name"
        raise AddressRefused(f"The host name cannot be resolved: {reason}.") from None
    addresses = [ipaddress.ip_address(where[0]) for *_, where in found]
    for address in addresses:
        if is_allowed(address, allowed) or (is_public(address) and is_web_port(port)):
            return str(address)
    public = next(filter(is_public, addresses), None)
    problem = (
        f"{addresses[0]} is not a public address."
        if public is None
        else f"Port {port} of {public} is neither 80 nor 443, and is below {FIRST_USER_PORT}."
    )
    raise AddressRefused(f"{problem} The operator can allow its network: {VARIABLE}.")
