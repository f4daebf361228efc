"""The client: one object for one service."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import httpx2

from eigenfail.client.analyses import Analyses
from eigenfail.client.campaigns import Campaigns
from eigenfail.client.episodes import Episodes
from eigenfail.client.events import Events
from eigenfail.client.keys import Keys, token_of
from eigenfail.client.link import Link
from eigenfail.client.reports import NOTHING, check_folder, fetch_report, write_report
from eigenfail.client.suites import Suites
from eigenfail.errors import EigenfailError
from eigenfail.values import Page
from eigenfail.values.report import Report
from eigenfail.values.worker import Presence, Staffing, WorkerShare
from eigenfail.wire.http import PluginInfo

DEFAULT_URL = "http://127.0.0.1:8440"


class Client:
    """An eigenfail service, over HTTP.

    Errors are those of `eigenfail.errors`, with the service's remedy. Requests that may safely
    come twice are sent again while the service is busy or away for a moment.

    Args:
        base_url: address of the service.
        transport: instead of sockets, for tests and for services in this process.
        key: what the service asks for, `ef_…`; None takes that of EIGENFAIL_KEY, if it is set.
    """

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        self._link = Link(base_url, transport, token_of(key))
        self.campaigns = Campaigns(self._link)
        self.suites = Suites(self._link, self.campaigns)
        self.episodes = Episodes(self._link)
        self.analyses = Analyses(self._link)
        self.events = Events(self._link)
        self.keys = Keys(self._link)

    @property
    def url(self) -> str:
        """Address of the service; its dashboard is there."""
        return self._link.base_url

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
        found = self._link.get("/workers", Page[WorkerShare], {"within_s": within_s})
        return found.items

    def present_workers(self) -> tuple[Presence, ...]:
        """Who is connected now, at work or not, with host, process and versions."""
        return self._link.get("/workers/present", Page[Presence]).items

    def staffing(self) -> Staffing:
        """How many workers are there, and what the services said last of those they start."""
        return self._link.get("/workers/staffing", Staffing)

    def report(
        self,
        campaigns: int | Sequence[int],
        folder: Path | str,
        force: bool = False,
        also: Mapping[str, bytes] = NOTHING,
    ) -> Report:
        """Write a report on campaigns into a folder: report.html, and its data beside it.

        The folder has all of it or is not there: nothing is left half-written.

        Args:
            campaigns: one, or several in the order in which they are told of.
            folder: that is not there yet, or is empty.
            force: replace the report that is in the folder.
            also: further files for the folder, by name.

        Raises:
            NotFound: no such campaign.
            InvalidValue: no campaign, too many, one that is named twice, or a folder that would be
                overwritten.
            ServiceError: the folder cannot be written.
        """
        check_folder(Path(folder), force)
        return write_report(fetch_report(self._link, campaigns), Path(folder), also)

    def health(self) -> bool:
        """Whether the service answers and reaches its database."""
        return self._link.answers("/readyz")

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
