"""Episodes, as a client sees them: read, replayed, and exported to files."""

from collections.abc import Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any, TypedDict, Unpack, overload

import msgspec

from eigenfail.client.link import Extent, Link, reverse_order
from eigenfail.client.references import (
    CampaignLike,
    EpisodeLike,
    find_campaign_id,
    locate_campaign,
    locate_episode,
    split_text,
)
from eigenfail.contracts.recording import EgoControl
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.files import write_whole
from eigenfail.filters import Value, find_column, parse_sort
from eigenfail.values.campaign import Campaign
from eigenfail.values.episode import Outcome
from eigenfail.values.failures import FailureRequest, parse_failure_sort
from eigenfail.values.operations import Presence
from eigenfail.values.proof import Explanation
from eigenfail.values.records import EpisodeDetail, EpisodeRow, Page
from eigenfail.values.rows import Rows
from eigenfail.wire.http import ReplayRequest, read_fields

Picked = dict[str, Value | None]
"""Columns of an episode by their names; None where nothing was measured."""


class ExportFormat(StrEnum):
    """File format of exported episodes."""

    CSV = "csv"
    NDJSON = "ndjson"
    PARQUET = "parquet"


class ExportRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Contents of an export; see docs/episodes.md.

    Attributes:
        filter: conditions on the episodes.
        sort: order of the episodes.
        fields: columns; empty for all columns.
        noise: whether z of each episode is included, as `<channel>_z`: on a road `longitudinal_z`
            and `lateral_z`. [sigma]
    """

    filter: str = ""
    sort: str = "index"
    fields: tuple[str, ...] = ()
    noise: bool = False


class ExportOptions(TypedDict, total=False):
    """Selection of the episodes and columns of an export.

    Attributes:
        filter: conditions on the episodes.
        sort: order of the episodes.
        fields: columns; empty for all columns.
        noise: whether z of each episode is included. [sigma]
    """

    filter: str
    sort: str
    fields: Sequence[str]
    noise: bool


class FailureFields(TypedDict, total=False):
    """Selection and order of the listed failures of all campaigns.

    Attributes:
        project: project of the campaigns.
        planner: planner of the campaigns.
        planner_version: version of the planner, as the campaigns state it.
        method: method of the campaigns.
        archived: whether failures of archived campaigns are listed, too.
        sort: -severity for the most severe first, or severity.
    """

    project: str | None
    planner: str | None
    planner_version: str | None
    method: str | None
    archived: bool
    sort: str


class Episodes:
    """Read, replay and export episodes.

    docs/episodes.md describes filters, sort orders and columns. Every method raises
    ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    @overload
    def list(
        self,
        campaign: CampaignLike,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",
        sort: str = "index",
    ) -> Rows[EpisodeRow]: ...

    @overload
    def list(
        self,
        campaign: CampaignLike,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",
        sort: str = "index",
        fields: Sequence[str],
    ) -> Rows[Picked]: ...

    def list(
        self,
        campaign: CampaignLike,
        outcome: Outcome | str | None = None,
        *,
        filter: str = "",  # noqa: A002 - the word that users know it by
        sort: str = "index",
        fields: Sequence[str] = (),
    ) -> Rows[Any]:
        """List the finished episodes of a campaign, loaded page by page on demand.

        Args:
            campaign: the campaign, or its id.
            outcome: only episodes with this outcome: collision, safe or errored; equivalent to a
                condition of the filter.
            filter: conditions such as "severity > 80 and min_ttc_s < 1.5".
            sort: a column, or -column for the largest first; episodes without a value come last.
            fields: columns to return of each episode, as a dict; if empty, each row is a whole
                EpisodeRow.

        Raises:
            NotFound: no such campaign.
            UnknownName: a column or a value does not exist.
            InvalidValue: the filter cannot be parsed (the error gives the position), or `fields` is
                a single text.
        """
        # A text is a sequence of letters, each of which would be an unknown column.
        if isinstance(fields, str):
            problem = f"'{fields}' is one text."
            named = [name.strip() for name in fields.split(",")]
            raise InvalidValue("fields", problem, f"Give a list of names: fields={named}.")
        for name in fields:
            # A list asks the service late, maybe far from the call with the wrong name.
            find_column(name, "fields")
        path = f"{locate_campaign(campaign)}/episodes"
        asked = {"outcome": outcome, "filter": filter or None, "sort": sort}
        picked = {**asked, "fields": ",".join(fields)} if fields else asked
        kind: type[Page[Any]] = Page[Picked] if fields else Page[EpisodeRow]
        reverse = reverse_order(picked, parse_sort(sort), "index")
        extent = Extent(partial(self._link.count, path, asked), reverse, tuple(fields))
        return self._link.pages(path, kind, "after", picked, extent)

    def list_failures(self, **wanted: Unpack[FailureFields]) -> Rows[EpisodeRow]:
        """List the collisions of all campaigns by severity, loaded page by page on demand.

        Violations without a collision are left out, since they do not have a severity. Failures of
        methods that repeat earlier failures are left out unless `method` names such a method.

        Args:
            wanted: project, planner, planner_version and method of the campaigns; `archived`:
                whether failures of archived campaigns are listed;
                sort: -severity for the most severe first, or severity.

        Raises:
            UnknownName: unknown order.
        """
        asked = read_fields(wanted, FailureRequest)
        parse_failure_sort(asked.sort)
        params = {**msgspec.to_builtins(asked), "archived": "true" if asked.archived else None}
        return self._link.pages("/failures", Page[EpisodeRow], "after", params)

    def export(
        self,
        campaign: CampaignLike,
        path: Path | str,
        format: ExportFormat | str | None = None,  # noqa: A002 - as for files elsewhere
        **wanted: Unpack[ExportOptions],
    ) -> Path:
        """Write finished episodes of a campaign to a file, either completely or not at all.

        Args:
            campaign: the campaign, or its id.
            path: path of the file; an existing file is replaced.
            format: csv, ndjson or parquet; None chooses by the file's name.
            wanted: filter, sort and fields as in `list`; noise=True adds z, in Parquet only.

        Returns:
            The path.

        Raises:
            NotFound: no such campaign.
            UnknownName: a format, column or value does not exist.
            InvalidValue: the filter cannot be parsed, the format cannot hold the data, or the
                service cannot write the format.
            ServiceError: the file cannot be written.
        """
        request = read_fields(wanted, ExportRequest)
        place = Path(path)
        form = _choose_format(place, format)
        asked = _list_parameters(request, form)
        address = f"/campaigns/{find_campaign_id(campaign)}/episodes.{form}"
        write_whole(place, self._link.chunks(address, asked))
        return place

    def export_recording(
        self,
        campaign: CampaignLike,
        index: EpisodeLike | Path | str | None = None,
        path: Path | str | None = None,
        format: str | None = None,  # noqa: A002 - as for files elsewhere
        ego: EgoControl | str = EgoControl.RECORDED,
    ) -> Path:
        """Write one episode to a file of another tool, either completely or not at all.

        If the scene of the episode was not kept, the service runs the episode again.

        Args:
            campaign: the campaign, or its id; or the episode, as listed.
            index: the episode, or its index; left out if `campaign` is the episode:
                `export_recording(row, "failure.gif")`.
            path: path of the file; an existing file is replaced.
            format: openscenario (a ZIP archive), mcap, gif or another format for which the service
                has a plug-in; None chooses by the file's name.
            ego: `recorded`: the ego repeats its course; `controller`: a controller of the simulator
                drives the ego. Only OpenSCENARIO offers the choice.

        Returns:
            The path.

        Raises:
            NotFound: no such campaign, or no result of the episode yet.
            UnknownName: the format or the kind of ego does not exist.
            InvalidValue: the path is missing, the episode is without vehicles, or the service
                cannot write the format.
            Conflict: the scene was not kept, and a replay of the episode differs.
            ServiceError: the file cannot be written, or the episode cannot be run again.
        """
        episode, named = split_text("path", index, path)
        file = Path(named)
        asked = {"format": choose_recording_format(file, format), "ego": _choose_ego(ego)}
        place = f"{locate_episode(campaign, episode)}/recording"
        write_whole(file, self._link.chunks(place, asked))
        return file

    def get(self, campaign: CampaignLike, index: EpisodeLike | None = None) -> EpisodeDetail:
        """Return one result with its class, its noise and, if it was kept, its scene.

        Raises:
            NotFound: no such campaign, or no result of the episode yet.
        """
        result = self._link.get(locate_episode(campaign, index), EpisodeDetail)
        # JSON forgets the shape (steps, channels) where there is no step.
        arrays = (result.noise.z, result.noise.sigma)
        z, sigma = (each.reshape(-1, len(result.channels)) for each in arrays)
        noise = msgspec.structs.replace(result.noise, z=z, sigma=sigma)
        return msgspec.structs.replace(result, noise=noise)

    def worker(self, campaign: CampaignLike, index: EpisodeLike | None = None) -> Presence:
        """Return the worker that ran an episode, with its host, process and versions.

        Raises:
            NotFound: no such episode, or its worker is no longer known.
        """
        return self._link.get(f"{locate_episode(campaign, index)}/worker", Presence)

    def explanation(self, campaign: CampaignLike, index: EpisodeLike | None = None) -> Explanation:
        """Run an episode again on the service, and return its planner's account of each step.

        Raises:
            NotFound: no such campaign, or no result of the episode yet.
            UnknownName: the service does not have a plug-in of the campaign.
            InvalidValue: the episode cannot be run again.
            ServiceError: too many explanations are waiting already.
        """
        return self._link.get(f"{locate_episode(campaign, index)}/explanation", Explanation)

    def replay(
        self, campaign: CampaignLike, index: EpisodeLike | None = None, scale: float = 1.0
    ) -> Campaign:
        """Queue and return a new campaign of one episode that injects this episode's noise again.

        Args:
            campaign: the campaign, or its id.
            index: the episode, or its index.
            scale: factor for the noise, 0.1 to 2; 1 injects the recorded noise.

        Raises:
            NotFound: no such campaign, or no result of the episode yet.
            InvalidValue: the scale is outside its bounds, or the episode is without noise.
        """
        path = f"{locate_episode(campaign, index)}/replay"
        return self._link.post(path, Campaign, ReplayRequest(scale))


def _list_parameters(request: ExportRequest, form: ExportFormat) -> dict[str, Any]:
    """Return the parameters of a request for a file.

    Raises:
        InvalidValue: noise is requested, but the format cannot hold it.
    """
    if request.noise and form is not ExportFormat.PARQUET:
        raise InvalidValue("noise", f"{form} holds no noise.", "Use the format parquet.")
    return {
        "filter": request.filter or None,
        "sort": request.sort,
        "fields": ",".join(request.fields) or None,
        "noise": "true" if request.noise else None,
    }


def _choose_format(path: Path, form: ExportFormat | str | None) -> ExportFormat:
    """Return the requested format, or else the format that the ending of a file's name gives.

    Raises:
        UnknownName: the format does not exist.
    """
    name = form or path.suffix.removeprefix(".").lower()
    if name not in list(ExportFormat):
        raise UnknownName("format", name, ExportFormat)
    return ExportFormat(name)


OPENSCENARIO, ARCHIVE = "openscenario", ".zip"
"""The one known format whose files do not end in its name."""


def choose_recording_format(path: Path, form: str | None) -> str:
    """Return the name of the requested format, or else the ending of a file's name.

    The service checks whether the format exists, since its plug-ins bring the formats.

    Raises:
        InvalidValue: OpenSCENARIO is to be written to a file whose name is not an archive's.
    """
    suffix = path.suffix.lower()
    name = form or (OPENSCENARIO if suffix == ARCHIVE else suffix.removeprefix("."))
    if name in {OPENSCENARIO, "xosc"} and suffix != ARCHIVE:
        problem = "OpenSCENARIO is written as a ZIP archive of scenario, road and noise."
        raise InvalidValue("output", problem, f"Name the file {path.stem}{ARCHIVE}.")
    return name


def _choose_ego(ego: EgoControl | str) -> EgoControl:
    if ego not in list(EgoControl):
        raise UnknownName("ego", ego, EgoControl)
    return EgoControl(ego)
