"""The client: one object for one service, with its keys and its events."""

import os
from collections.abc import Iterator
from types import TracebackType
from typing import Self

import httpx2

from eigenfail.client.analyses import Analyses, TriageRecords
from eigenfail.client.campaigns import Campaigns
from eigenfail.client.episodes import Episodes
from eigenfail.client.link import Link, rest
from eigenfail.client.references import (
    CampaignLike,
    EventLike,
    KeyLike,
    find_campaign_id,
    find_event_id,
    locate_key,
)
from eigenfail.client.suites import Suites
from eigenfail.client.versions import Gates, Releases
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values import access
from eigenfail.values.operations import Event, Presence, Staffing, WorkerShare
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.wire import http
from eigenfail.wire.http import PluginInfo, read_fields

KEY_VARIABLE = "EIGENFAIL_KEY"
DEFAULT_URL = "http://127.0.0.1:8440"
URL_VARIABLE = "EIGENFAIL_URL"

RECONNECT_S = 0.5
MAX_FAILURES = 5


class Client:
    """An eigenfail service, over HTTP.

    Methods raise the errors in `eigenfail.errors`, with the service's remedy. Requests that are
    safe to repeat are sent again while the service is busy or briefly unreachable.

    Args:
        base_url: address of the service; None takes EIGENFAIL_URL or, if it is not set,
            http://127.0.0.1:8440.
        transport: replaces sockets, for tests and for services in this process; EIGENFAIL_URL is
            then ignored.
        key: API key for the service, `ef_…`; None takes EIGENFAIL_KEY, if it is set.
    """

    def __init__(
        self,
        base_url: str | None = None,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        # A transport is a service in this process, which the environment knows nothing of.
        by_default = DEFAULT_URL if transport else os.environ.get(URL_VARIABLE) or DEFAULT_URL
        self._link = Link(base_url or by_default, transport, find_token(key))
        self.campaigns = Campaigns(self._link)
        self.suites = Suites(self._link, self.campaigns)
        self.episodes = Episodes(self._link)
        self.analyses = Analyses(self._link)
        self.triage = TriageRecords(self._link)
        self.releases = Releases(self._link)
        self.gates = Gates(self._link)
        self.events = Events(self._link)
        self.keys = Keys(self._link)

    @property
    def url(self) -> str:
        """Address of the service and its dashboard."""
        return self._link.base_url

    @property
    def link(self) -> Link:
        """Typed requests to routes of plug-ins: `link.post("/risk", RiskAssessment, …)`."""
        return self._link

    def methods(self) -> tuple[PluginInfo, ...]:
        """List the methods that campaigns can use, with the JSON schema of their settings."""
        return self._plugins("methods")

    def planners(self) -> tuple[PluginInfo, ...]:
        """List the planners that can be tested, with the JSON schema of their settings."""
        return self._plugins("planners")

    def scenarios(self) -> tuple[PluginInfo, ...]:
        """List the scenarios, with the JSON schema of their parameters."""
        return self._plugins("scenarios")

    def simulators(self) -> tuple[PluginInfo, ...]:
        """List the simulators."""
        return self._plugins("simulators")

    def workers(self, within_s: int = 600) -> tuple[WorkerShare, ...]:
        """Return workers with results in the last `within_s` seconds; only these results count."""
        return self._link.get("/workers", Page[WorkerShare], {"within_s": within_s}).items

    def present_workers(self) -> tuple[Presence, ...]:
        """Return the connected workers, busy or idle, with host, process and versions."""
        return self._link.get("/workers/present", Page[Presence]).items

    def staffing(self) -> Staffing:
        """Return the number of workers, and the services' last report on workers they start."""
        return self._link.get("/workers/staffing", Staffing)

    def health(self) -> bool:
        """Return whether the service answers and reaches its database."""
        return self.trouble() is None

    def trouble(self) -> EigenfailError | None:
        """Return why the service is unhealthy: no answer or a database fault; None if healthy."""
        return self._link.trouble("/readyz")

    def close(self) -> None:
        """Close all connections."""
        self._link.close()

    def __repr__(self) -> str:
        """Return the class name and the address of the service."""
        return f"Client({self.url!r})"

    def __enter__(self) -> Self:
        """Return the client itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the client."""
        self.close()

    def _plugins(self, kind: str) -> tuple[PluginInfo, ...]:
        return self._link.get(f"/{kind}", Page[PluginInfo]).items


class Keys:
    """Make, list, limit and revoke keys.

    Every method raises Unauthorized without a valid key, Forbidden if the key does not have the
    scope admin, and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self,
        name: str,
        scope: access.Scope | str = access.Scope.VIEWER,
        expires_s: int | None = None,
        quotas: access.Quotas = access.UNLIMITED,
    ) -> access.NewKey:
        """Make a key; the answer has its token, which cannot be read again later.

        Args:
            name: user or purpose of the key.
            scope: viewer reads, runner also starts and steers, admin may do everything.
            expires_s: how long it is valid [s]; None: until it is revoked.
            quotas: limits on the use of the key.

        Raises:
            InvalidValue: a value outside its bounds, or a first key without the scope admin.
        """
        wanted = {"name": name, "scope": scope, "expires_s": expires_s, "quotas": quotas}
        return self._link.post("/keys", access.NewKey, read_fields(wanted, access.KeyRequest))

    def list(self) -> Rows[access.ApiKey]:
        """List all keys, newest first, including keys that are no longer valid."""
        return self._link.pages("/keys", Page[access.ApiKey], "before")

    def get(self, key: KeyLike) -> access.ApiKey:
        """Return a key, without its secret.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(locate_key(key), access.ApiKey)

    def usage(self, key: KeyLike) -> access.Usage:
        """Return how much of a key's quotas its campaigns use now.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(f"{locate_key(key)}/usage", access.Usage)

    def limit(self, key: KeyLike, quotas: access.Quotas) -> access.ApiKey:
        """Set the quotas of a key from now on; its earlier campaigns stay and count.

        Raises:
            NotFound: no such key.
        """
        return self._link.post(f"{locate_key(key)}/quotas", access.ApiKey, quotas)

    def revoke(self, key: KeyLike) -> access.ApiKey:
        """Revoke a key permanently.

        Raises:
            NotFound: no such key.
        """
        return self._link.delete(locate_key(key), access.ApiKey)

    def audit(self) -> Rows[access.AuditEntry]:
        """List all changes with their authors, newest first."""
        return self._link.pages("/audit", Page[access.AuditEntry], "before")


class Events:
    """Follow the event log of a service."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def follow(self, after: EventLike = 0, campaign: CampaignLike | None = None) -> Iterator[Event]:
        """Yield events without end, also across lost connections and restarts.

        Args:
            after: begin after this event, or the event with this id; 0 begins with the oldest one.
            campaign: only events of this campaign.

        Raises:
            NotFound: no such campaign.
            ServiceUnreachable: the service does not come back.
        """
        last, failures = find_event_id(after), 0
        number = None if campaign is None else find_campaign_id(campaign)
        while True:
            try:
                # Each connection begins behind the last event that was yielded: none is missed.
                for event in self._connected(last, number):
                    last, failures = event.id, 0
                    yield event
            except httpx2.TransportError as error:
                # Failures in a row: an event in between proves that the service is there.
                failures += 1
                if failures == MAX_FAILURES:
                    raise self._link.unreachable(error) from error
            rest.get()(RECONNECT_S)

    def _connected(self, after: int, campaign: int | None) -> Iterator[Event]:
        """Yield the events of one connection; events without data only mark a position."""
        place = {"Last-Event-ID": str(after)}
        with self._link.stream("/events", {"campaign": campaign}, place) as events:
            for event in events:
                if event.data:
                    yield http.decode(event.data.encode(), Event)


def find_token(given: str | None) -> str | None:
    """Return the given key, or else the key in the environment, if there is one.

    Raises:
        InvalidValue: it does not look like a key; the error does not repeat the text.
    """
    token = (os.environ.get(KEY_VARIABLE, "") if given is None else given).strip()
    # Found here, since a service would count it as a failed login; white space comes from `$(cat)`.
    if token and access.TOKEN.fullmatch(token) is None:
        raise InvalidValue(
            "key",
            "the value is not of the form ef_ID_SECRET.",
            f"Check {KEY_VARIABLE} or the argument `key`; `eigenfail key create` makes keys.",
        )
    return token or None
