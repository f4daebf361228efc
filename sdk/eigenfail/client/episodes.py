"""Episodes, as a client sees them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict, Unpack, overload

import msgspec

from eigenfail.client.exports import Exports
from eigenfail.client.link import Link
from eigenfail.filters import Value
from eigenfail.rows import Rows
from eigenfail.values import Campaign, Explanation, Outcome, Page
from eigenfail.values.arrays import Floats
from eigenfail.values.export import ExportFormat, ExportRequest
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.worker import Presence
from eigenfail.wire.http import ReplayRequest, read_fields

Picked = dict[str, Value | None]
"""Columns of an episode by their names; None where nothing was measured."""


class Wanted(TypedDict, total=False):
    """What an export is to hold.

    Attributes:
        filter: conditions on its episodes.
        sort: their order.
        fields: columns; all of them if none is named.
        noise: whether each episode's z comes along. [sigma]
    """

    filter: str
    sort: str
    fields: Sequence[str]
    noise: bool


class Episodes:
    """Read what came of episodes.

    Filters, sorts and columns are those of docs/episodes.md. Every method raises
    ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._exports = Exports(link)

    @overload
    def list(
        self,
        campaign: int,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",
        sort: str = "index",
    ) -> Rows[EpisodeRow]: ...

    @overload
    def list(
        self,
        campaign: int,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",
        sort: str = "index",
        fields: Sequence[str],
    ) -> Rows[Picked]: ...

    def list(
        self,
        campaign: int,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",  # noqa: A002 - the word that users know it by
        sort: str = "index",
        fields: Sequence[str] = (),
    ) -> Rows[Any]:
        """The finished episodes of a campaign, page by page as they are wanted.

        Args:
            campaign: its id.
            outcome: only those that ended like this; the same as a condition of the filter.
            filter: conditions such as "severity > 80 and min_ttc_s < 1.5".
            sort: a column, or -column for the largest first; without a value they come last.
            fields: of each episode only these columns, as a dict; all of it, as an EpisodeRow,
                if none is named.

        Raises:
            NotFound: no such campaign.
            UnknownName: a column or a value that there is not.
            InvalidValue: a filter that cannot be read; the error says where.
        """
        path = f"/campaigns/{campaign}/episodes"
        asked = {"outcome": outcome, "filter": filter or None, "sort": sort}
        if not fields:
            return self._link.pages(path, Page[EpisodeRow], "after", asked)
        picked = {**asked, "fields": ",".join(fields)}
        return self._link.pages(path, Page[Picked], "after", picked)

    def export(
        self,
        campaign: int,
        path: Path | str,
        format: ExportFormat | str | None = None,  # noqa: A002 - as for files elsewhere
        **wanted: Unpack[Wanted],
    ) -> Path:
        """Write finished episodes of a campaign to a file; it is there whole, or not at all.

        Args:
            campaign: its id.
            path: of the file; one that is there is replaced.
            format: csv, ndjson or parquet; by the file's name if it is not given.
            wanted: filter, sort and fields as in `list`; noise=True for z, in Parquet.

        Returns:
            The path.

        Raises:
            NotFound: no such campaign.
            UnknownName: a format, column or value that there is not.
            InvalidValue: a filter that cannot be read, or a format that cannot hold what is
                wanted, or that the service cannot write.
            ServiceError: the export failed, or the file cannot be written.
        """
        request = read_fields(wanted, ExportRequest)
        return self._exports.save(campaign, request, Path(path), format)

    def get(self, campaign: int, index: int) -> EpisodeDetail:
        """One result with its class, its noise and, where it was kept, its scene.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
        """
        result = self._link.get(f"/campaigns/{campaign}/episodes/{index}", EpisodeDetail)
        z, sigma = pairs(result.noise.z), pairs(result.noise.sigma)
        noise = msgspec.structs.replace(result.noise, z=z, sigma=sigma)
        return msgspec.structs.replace(result, noise=noise)

    def worker(self, campaign: int, index: int) -> Presence:
        """Who ran an episode, where, and with which versions.

        Raises:
            NotFound: no such episode, or nothing is known of its worker any more.
        """
        return self._link.get(f"/campaigns/{campaign}/episodes/{index}/worker", Presence)

    def explanation(self, campaign: int, index: int) -> Explanation:
        """An episode run again by the service, with its planner's account of each step.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
            UnknownName: the service does not have a plug-in of the campaign.
            InvalidValue: the episode cannot be run again.
            ServiceError: too many wait for an explanation already.
        """
        return self._link.get(f"/campaigns/{campaign}/episodes/{index}/explanation", Explanation)

    def replay(self, campaign: int, index: int, scale: float = 1.0) -> Campaign:
        """A new campaign of one episode that injects this one's noise again, queued.

        Args:
            campaign: its id.
            index: of the episode.
            scale: by which the noise is multiplied, 0.1 to 2; 1 injects it as it was.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
            InvalidValue: the scale is outside its bounds, or the episode has no noise.
        """
        path = f"/campaigns/{campaign}/episodes/{index}/replay"
        return self._link.post(path, Campaign, ReplayRequest(scale))


def pairs(array: Floats) -> Floats:
    """The array in its shape (steps, 2), which JSON forgets where there is no step."""
    return array.reshape(-1, 2)
