"""Sign-in by a reverse proxy, which names the user in headers that are trusted from it alone.

A client can send any header. So a user's headers count only if the peer of the TCP connection is
in a network that the operator named. Neither `X-Forwarded-For` nor another header changes the
address of the peer. The headers of other peers are ignored.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Send
from starlette.types import Scope as Asked

from eigenfail.errors import Forbidden
from eigenfail.values.access import Scope, redact
from eigenfail_api.settings import ApiSettings

PEER = "eigenfail.peer"
"""Address of the peer in the scope of a request."""

ANY_GROUP = "*"
"""Name in the setting that stands for every user whom the proxy lets pass."""

LONGEST_NAME = 100
NAME = re.compile(rf"[^\s,;\"<>]([^,;\"<>\t\r\n]{{0,{LONGEST_NAME - 2}}}[^\s,;\"<>])?")
"""A user: no list, as of two headers that a proxy joined."""

Networks = Iterable[IPv4Network | IPv6Network]


class PeerRecorder:
    """Middleware: record the peer of the connection, before headers change the client's address.

    Args:
        app: the application, including the middleware that reads `X-Forwarded-For`.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Asked, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] == "http":
            client = scope.get("client")
            scope[PEER] = client[0] if client else ""
        await self._app(scope, receive, send)


@dataclass(frozen=True)
class ProxyUser:
    """A user whom a trusted proxy signed in.

    Attributes:
        name: name of the user, as the proxy sends it.
        scope: the highest scope of the user's groups.
    """

    name: str
    scope: Scope


class ProxySignIn:
    """Reads the user of a request from the headers of a trusted proxy.

    Args:
        settings: networks of proxies, names of their headers, and the scopes of groups.
    """

    def __init__(self, settings: ApiSettings) -> None:
        self._networks = settings.sign_in_proxies
        self._user_header = settings.sign_in_user_header
        self._groups_header = settings.sign_in_groups_header
        self._scopes: Mapping[str, Scope] = settings.sign_in_scopes

    def find_user(self, request: HTTPConnection) -> ProxyUser | None:
        """Return the user of a request; None if no trusted proxy names one.

        Raises:
            Forbidden: a header is repeated, or does not name exactly one user; or the user lacks a
                scope.
        """
        if not is_within(request.scope.get(PEER, ""), self._networks):
            return None
        given = self._read_header(request, self._user_header)
        if given is None:
            return None
        if not NAME.fullmatch(given):
            raise Forbidden(
                f"The header {self._user_header} of the proxy does not name one user.",
                "Have the proxy replace the header that a client sends, and not append to it.",
            )
        groups = self._read_header(request, self._groups_header) or ""
        return ProxyUser(redact(given), self._find_scope(given, groups))

    def _find_scope(self, name: str, groups: str) -> Scope:
        names = {ANY_GROUP, *(group.strip() for group in groups.split(","))}
        scopes = [scope for group, scope in self._scopes.items() if group in names]
        if not scopes:
            raise Forbidden(
                f"No group of the user '{name}' has a scope here.",
                "The operator names groups with their scopes in EIGENFAIL_SIGN_IN_SCOPES.",
            )
        # Scopes are declared in rising order.
        return max(scopes, key=[*Scope].index)

    def _read_header(self, request: HTTPConnection, name: str) -> str | None:
        values = request.headers.getlist(name)
        if len(values) > 1:
            raise Forbidden(
                f"The proxy sent the header {name} {len(values)} times.",
                "Have the proxy replace the header that a client sends, and not append to it.",
            )
        if not values:
            return None
        try:
            # The server decodes headers as Latin-1, and proxies send names in UTF-8.
            text = values[0].encode("latin-1").decode()
        except UnicodeError:
            # Empty and not None: a header without a name must be refused, and not be taken for
            # missing.
            return ""
        return text.strip() if text.isprintable() else ""


def is_within(address: str, networks: Networks) -> bool:
    """Return whether an address is in one of the networks."""
    parsed = parse_address(address)
    return parsed is not None and any(parsed in network for network in networks)


def parse_address(address: str) -> IPv4Address | IPv6Address | None:
    """Return the address that a text names, or None. IPv4 written as IPv6 comes back as IPv4."""
    try:
        # A link-local address of IPv6 may end with % and the name of an interface.
        parsed = ip_address(address.partition("%")[0])
    except ValueError:
        return None
    mapped = parsed.ipv4_mapped if isinstance(parsed, IPv6Address) else None
    return mapped or parsed
