"""Settings of the API, and refusals of unsafe ones."""

from collections.abc import Iterable, Iterator
from ipaddress import IPv4Network, IPv6Network, collapse_addresses
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from eigenfail.addresses import is_loopback
from eigenfail.errors import InvalidValue
from eigenfail.values.access import Scope
from eigenfail_services.store.access import KeyStore
from eigenfail_services.store.clock import now_ms

SHORTEST_PREFIX = {4: 8, 6: 16}
"""Length of the prefix of the widest network of proxies that sign users in, by version of IP."""

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")

Network = IPv4Network | IPv6Network

HeaderName = Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,100}$")]


class ApiSettings(BaseSettings):
    """Settings of the API: from arguments or else environment variables EIGENFAIL_<NAME>.

    Attributes:
        database: URL of the store.
        host: address to listen on.
        port: port to listen on; 0 takes a free one.
        health_host: address of the port for health checks alone.
        health_port: port for /healthz and /readyz, which are answered even if the main port is
            busy; 0 takes a free one, None opens none.
        require_keys: ask for a key even before there is one; then, and with the key of an
            administrator, other machines may reach the address.
        trust_network: listen for other machines although no key is required. For containers
            behind a private network, and nothing else.
        hosts: accepted host names, against DNS rebinding; see `names`.
        proxies: addresses of proxies before it, whose X-Forwarded-For and X-Forwarded-Proto
            identify the client.
        sign_in_proxies: networks of proxies that sign users in; headers that name a user are
            believed only from peers in the networks.
        sign_in_user_header: the header that names the user.
        sign_in_groups_header: the header that lists the groups of the user, with commas in between.
        sign_in_scopes: scope of each group; `*` means every user.
        max_body_bytes: largest body of a request.
        max_connections: connections open at a time; while there are more, requests get a 503.
        max_requests_per_s: requests of one key that are answered, on average
            over five seconds; others get a 429.
        max_keyless_requests_per_s: the same for one address, if no key is required.
        poll_s: interval at which the event log is read for open event streams.
    """

    model_config = SettingsConfigDict(env_prefix="EIGENFAIL_", frozen=True, extra="forbid")

    database: str = "sqlite:///eigenfail-data/eigenfail.db"
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8440
    health_host: str = "127.0.0.1"
    health_port: Annotated[int, Field(ge=0, le=65535)] | None = None
    require_keys: bool = False
    trust_network: bool = False
    hosts: tuple[str, ...] | None = None
    proxies: tuple[str, ...] = ()
    sign_in_proxies: tuple[Network, ...] = ()
    sign_in_user_header: HeaderName = "X-Forwarded-User"
    sign_in_groups_header: HeaderName = "X-Forwarded-Groups"
    sign_in_scopes: dict[str, Scope] = {}
    max_body_bytes: Annotated[int, Field(ge=1)] = 1_000_000
    max_connections: Annotated[int, Field(ge=10)] = 500
    max_requests_per_s: Annotated[float, Field(gt=0.0)] = 200.0
    max_keyless_requests_per_s: Annotated[float, Field(gt=0.0)] = 500.0
    poll_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.25

    @property
    def is_private(self) -> bool:
        """Return whether only this machine can reach the address."""
        return is_loopback(self.host)

    @property
    def names(self) -> tuple[str, ...] | None:
        """Return the accepted host names: the configured ones, else the names of this machine.

        None accepts any name. It is returned if other machines may reach the service and every user
        needs a key: a page of another origin does not have a key to send.
        """
        if self.hosts is not None:
            return self.hosts
        return None if self.require_keys and not self.is_private else LOOPBACK_NAMES


def refuse_open_door(settings: ApiSettings) -> None:
    """Refuse an address that strangers can reach without a key.

    Raises:
        InvalidValue: other machines can reach the address, no key is required, and the network is
            not declared trusted.
    """
    if not (settings.is_private or settings.require_keys or settings.trust_network):
        raise InvalidValue(
            "host",
            f"'{settings.host}' is reachable from other machines, and authentication is off.",
            "Listen on 127.0.0.1, or make an administrator's key with `eigenfail key create` and "
            "set EIGENFAIL_REQUIRE_KEYS=1. EIGENFAIL_TRUST_NETWORK=1 vouches for a private "
            "network instead, and EIGENFAIL_HOSTS lists the host names of this machine.",
        )


def refuse_without_keys(settings: ApiSettings, keys: KeyStore) -> None:
    """Refuse to serve a non-loopback address while no administrator has a key.

    Raises:
        InvalidValue: the address is not loopback, the network is not trusted, and no administrator
            has a valid key.
    """
    if not (settings.is_private or settings.trust_network or keys.admins(now_ms())):
        raise InvalidValue(
            "host",
            f"'{settings.host}' is reachable from other machines, and no administrator has a valid "
            "key.",
            "Create one: `eigenfail key create NAME --scope admin --database URL`.",
        )


def refuse_unsafe_sign_in(settings: ApiSettings) -> None:
    """Refuse settings of the proxy sign-in that let every client name any user.

    Raises:
        InvalidValue: a network, or the union of adjacent ones, is wider than `SHORTEST_PREFIX`
            allows; no group has a scope; or one header is to name both user and groups.
    """
    if not settings.sign_in_proxies:
        return
    for network in _join_networks(settings.sign_in_proxies):
        if network.prefixlen < SHORTEST_PREFIX[network.version]:
            raise InvalidValue(
                "sign_in_proxies",
                f"the networks include all of {network}, where every client could name any user.",
                "Name the addresses of the proxies alone, such as 10.0.0.5/32: no network may be "
                "wider than /8, or /16 of IPv6.",
            )
    if not settings.sign_in_scopes:
        raise InvalidValue(
            "sign_in_scopes",
            "no group has a scope, so that no user whom the proxy signs in could do anything.",
            'Set EIGENFAIL_SIGN_IN_SCOPES, such as \'{"*": "viewer", "safety": "runner"}\'.',
        )
    if settings.sign_in_user_header.lower() == settings.sign_in_groups_header.lower():
        problem = "the same header cannot name both the user and the groups."
        raise InvalidValue("sign_in_groups_header", problem, "Name two headers.")


def _join_networks(networks: Iterable[Network]) -> Iterator[Network]:
    """Yield the fewest networks with the same addresses."""
    # Many small networks next to each other may add up to the whole internet, so they are judged
    # together.
    given = tuple(networks)
    yield from collapse_addresses(each for each in given if isinstance(each, IPv4Network))
    yield from collapse_addresses(each for each in given if isinstance(each, IPv6Network))
