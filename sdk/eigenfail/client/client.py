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

    Errors are those of `eigenfail.errors`, with the service's remedy. Requests that may safely
    come twice are sent again while the service is busy or away for a moment.

    Args:
        base_url: address of the service; None takes that of EIGENFAIL_URL or, if it is not set,
            http://127.0.0.1:8440.
        transport: instead of sockets, for tests and for services in this process, whose address
            EIGENFAIL_URL is not.
        key: what the service asks for, `ef_…`; None takes that of EIGENFAIL_KEY, if it is set.
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
        """Address of the service; its dashboard is there."""
        return self._link.base_url

    @property
    def link(self) -> Link:
        """Typed requests to routes that plug-ins bring: `link.post("/risk", RiskAssessment, …)`."""
        return self._link

    def methods(self) -> tuple[PluginInfo, ...]:
        """The methods that campaigns can use, with the JSON schema of their settings."""
        return self._plugins("methods")

    def planners(self) -> tuple[PluginInfo, ...]:
        """The planners that can be tested, with the JSON schema of their settings."""
        return self._plugins("planners")

    def scenarios(self) -> tuple[PluginInfo, ...]:
        """The scenarios, with the JSON schema of their parameters."""
        return self._plugins("scenarios")

    def simulators(self) -> tuple[PluginInfo, ...]:
        """The simulators."""
        return self._plugins("simulators")

    def workers(self, within_s: int = 600) -> tuple[WorkerShare, ...]:
        """Who brought results in the last seconds, and of which campaigns; only these count."""
        return self._link.get("/workers", Page[WorkerShare], {"within_s": within_s}).items

    def present_workers(self) -> tuple[Presence, ...]:
        """Who is connected now, at work or not, with host, process and versions."""
        return self._link.get("/workers/present", Page[Presence]).items

    def staffing(self) -> Staffing:
        """How many workers are there, and what the services said last of those they start."""
        return self._link.get("/workers/staffing", Staffing)

    def health(self) -> bool:
        """Whether the service answers and reaches its database."""
        return self.trouble() is None

    def trouble(self) -> EigenfailError | None:
        """Why it is not healthy: nothing answers, or its database cannot be read or written."""
        return self._link.trouble("/readyz")

    def close(self) -> None:
        """Let go of all connections."""
        self._link.close()

    def __repr__(self) -> str:
        """Where the service is."""
        return f"Client({self.url!r})"

    def __enter__(self) -> Self:
        """The client itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self.close()

    def _plugins(self, kind: str) -> tuple[PluginInfo, ...]:
        return self._link.get(f"/{kind}", Page[PluginInfo]).items


class Keys:
    """Make, list, limit and revoke keys.

    Every method raises Unauthorized without a valid key, Forbidden without one of the scope admin,
    and ServiceUnreachable if no service answers.
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
        """Make a key; its token is in the answer, and can never be read again.

        Args:
            name: who or what it is for.
            scope: viewer reads, runner also starts and steers, admin does everything.
            expires_s: for how long it is valid [s]; None: until it is revoked.
            quotas: how much may be done with it.

        Raises:
            InvalidValue: a value outside its bounds; or a first key that is not an administrator's.
        """
        wanted = {"name": name, "scope": scope, "expires_s": expires_s, "quotas": quotas}
        return self._link.post("/keys", access.NewKey, read_fields(wanted, access.KeyRequest))

    def list(self) -> Rows[access.ApiKey]:
        """All keys, newest first; those that are no longer valid, too."""
        return self._link.pages("/keys", Page[access.ApiKey], "before")

    def get(self, key: KeyLike) -> access.ApiKey:
        """A key, without its secret.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(locate_key(key), access.ApiKey)

    def usage(self, key: KeyLike) -> access.Usage:
        """What the campaigns of a key use of its quotas now.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(f"{locate_key(key)}/usage", access.Usage)

    def limit(self, key: KeyLike, quotas: access.Quotas) -> access.ApiKey:
        """Set the quotas of a key from now on; its earlier campaigns stay, and count.

        Raises:
            NotFound: no such key.
        """
        return self._link.post(f"{locate_key(key)}/quotas", access.ApiKey, quotas)

    def revoke(self, key: KeyLike) -> access.ApiKey:
        """Revoke a key, for good.

        Raises:
            NotFound: no such key.
        """
        return self._link.delete(locate_key(key), access.ApiKey)

    def audit(self) -> Rows[access.AuditEntry]:
        """Who changed what, newest first."""
        return self._link.pages("/audit", Page[access.AuditEntry], "before")


class Events:
    """The event log of a service, as it grows."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def follow(self, after: EventLike = 0, campaign: CampaignLike | None = None) -> Iterator[Event]:
        """Every event from now on without end, through cut connections and restarts.

        Args:
            after: begin behind this event, or the event with this id; 0 begins with the oldest one.
            campaign: only events of this campaign.

        Raises:
            NotFound: no such campaign.
            ServiceUnreachable: the service stays away.
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
        """The events of one connection; those without data only mark a place."""
        place = {"Last-Event-ID": str(after)}
        with self._link.stream("/events", {"campaign": campaign}, place) as events:
            for event in events:
                if event.data:
                    yield http.decode(event.data.encode(), Event)


def find_token(given: str | None) -> str | None:
    """Return the key that was given, or else that of the environment, if there is one.

    Raises:
        InvalidValue: it does not look like one; what was given is not repeated.
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
