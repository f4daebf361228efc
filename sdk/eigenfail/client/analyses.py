"""Analyses, as a client sees them."""

import io
import lzma
import re
import shutil
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import Any, Unpack, overload
from zipfile import BadZipFile, ZipFile, is_zipfile

import httpx2

from eigenfail.client.fields import AnalysisFields, refuse_fields_beside
from eigenfail.client.link import Link, wait_until
from eigenfail.client.references import (
    AnalysisLike,
    CampaignLike,
    CampaignsLike,
    ModeLike,
    find_campaign_ids,
    locate_analysis,
    locate_campaign,
    locate_mode,
    split_text,
)
from eigenfail.contracts.recording import ANIMATION
from eigenfail.errors import InvalidValue, ProtocolError, ServiceError
from eigenfail.files import write_whole
from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
    Mode,
    Page,
    Proof,
)
from eigenfail.values.report import Report
from eigenfail.values.rows import Rows
from eigenfail.values.triage import TriageState
from eigenfail.wire.http import ModeName, ProofRequest, decode, read_fields

OVER = frozenset({AnalysisState.DONE, AnalysisState.FAILED})


class Analyses:
    """Group the failures of campaigns, and prove by replay what they have in common.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self,
        campaign: CampaignLike,
        settings: AnalysisSettings | None = None,
        **fields: Unpack[AnalysisFields],
    ) -> Analysis:
        """A new analysis of a campaign's failures, queued.

        Args:
            campaign: the campaign, or its id.
            settings: all of them; or give those that are not as usual by name.
            fields: fields of AnalysisSettings, as plain data.

        Raises:
            NotFound: no such campaign.
            UnknownName: a setting that does not exist.
            InvalidValue: a setting outside its bounds, fields beside all settings, or further
                campaigns that are not there or do not go together with this one.
        """
        refuse_fields_beside("settings", settings, fields)
        wanted = settings or read_fields(fields, AnalysisSettings)
        return self._link.post(f"{locate_campaign(campaign)}/analyses", Analysis, wanted)

    def get(self, analysis: AnalysisLike) -> Analysis:
        """The analysis, with its result once it is done.

        Raises:
            NotFound: no such analysis.
        """
        return self._link.get(locate_analysis(analysis), Analysis)

    def list(self, campaign: CampaignLike) -> Rows[Analysis]:
        """The analyses of a campaign, newest first, without their results.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.pages(f"{locate_campaign(campaign)}/analyses", Page[Analysis], "before")

    def wait(
        self, analysis: AnalysisLike, poll_s: float = 0.3, timeout_s: float | None = None
    ) -> Analysis:
        """The analysis once it is done or has failed.

        Raises:
            NotFound: no such analysis.
            WaitTimeout: it is not over in time; it goes on all the same.
        """
        return wait_until(
            lambda: self.get(analysis),
            lambda seen: seen.state in OVER,
            poll_s,
            timeout_s,
            lambda seen: f"Analysis {seen.id} ({seen.state})",
        )

    def eigenfailures(self, analysis: AnalysisLike) -> tuple[FailureMode, ...]:
        """The failure modes, each with its eigenfailure.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"{locate_analysis(analysis)}/eigenfailures", Page[FailureMode]).items

    def modes(
        self,
        analysis: AnalysisLike,
        state: TriageState | str | None = None,
    ) -> tuple[Mode, ...]:
        """The failure modes by number, with their names and without their noise.

        Args:
            analysis: id of the analysis.
            state: only those in this state of triage.

        Raises:
            NotFound: no such analysis.
            InvalidValue: there is no such state.
        """
        path = f"{locate_analysis(analysis)}/modes"
        return self._link.get(path, Page[Mode], {"state": state}).items

    @overload
    def rename_mode(self, analysis: Mode, mode: str, name: None = None) -> Mode: ...

    @overload
    def rename_mode(
        self, analysis: AnalysisLike, mode: ModeLike | None = None, *, name: str
    ) -> Mode: ...

    @overload
    def rename_mode(self, analysis: AnalysisLike, mode: ModeLike, name: str) -> Mode: ...

    def rename_mode(
        self, analysis: AnalysisLike, mode: ModeLike | str | None = None, name: str | None = None
    ) -> Mode:
        """Give a failure mode a name.

        Args:
            analysis: the analysis, or its id; or the mode, as lists have it.
            mode: the mode, or its number, from 1; left out where `analysis` is the mode:
                `rename_mode(mode, "late braking")`.
            name: at most 80 characters.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: the name is missing, empty, too long, or cannot be printed.
        """
        number, given = split_text("name", mode, name)
        place = f"{locate_mode(analysis, number)}/name"
        return self._link.put(place, Mode, read_fields({"name": given}, ModeName))

    @overload
    def animate(
        self, analysis: Mode, mode: Path | str, path: None = None, format: str = ANIMATION
    ) -> Path: ...

    @overload
    def animate(
        self,
        analysis: AnalysisLike,
        mode: ModeLike | None = None,
        *,
        path: Path | str,
        format: str = ANIMATION,
    ) -> Path: ...

    @overload
    def animate(
        self, analysis: AnalysisLike, mode: ModeLike, path: Path | str, format: str = ANIMATION
    ) -> Path: ...

    def animate(
        self,
        analysis: AnalysisLike,
        mode: ModeLike | Path | str | None = None,
        path: Path | str | None = None,
        format: str = ANIMATION,  # noqa: A002 - as for files elsewhere
    ) -> Path:
        """Write the failures of a mode, drawn over each other, as an animated GIF.

        Args:
            analysis: the analysis, or its id; or the mode, as lists have it.
            mode: the mode, or its number, from 1; left out where `analysis` is the mode:
                `animate(mode, "mode.gif")`.
            path: path of the file; one that is there is replaced.
            format: gif, or another one for which the service has a plug-in.

        Returns:
            The path.

        Raises:
            NotFound: no such analysis or mode.
            UnknownName: the service has no such format.
            Conflict: it is not done, or none of the failures has a scene.
            InvalidValue: the path is missing, or the service cannot write the format.
            ServiceError: the file cannot be written.
        """
        number, named = split_text("path", mode, path)
        file = Path(named)
        place = f"{locate_mode(analysis, number)}/animation"
        write_whole(file, self._link.chunks(place, {"format": format}))
        return file

    def prove(
        self, analysis: AnalysisLike, variations: Sequence[Mapping[str, Any]] | None = None
    ) -> Proof:
        """Have eigenfailures and medoids replayed, in a campaign for each scenario.

        Failures that are replayed there already are not replayed again. Wait for the end with
        `wait_for_proof`.

        Args:
            analysis: the analysis, or its id.
            variations: scenario parameters, each put over those of the analysed campaign, {} for
                its own scenario; None takes that and its neighbours to both sides.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done, found no failure mode, or is of several worlds.
            UnknownName: a parameter that the scenario does not have.
            InvalidValue: a parameter outside its bounds, a distribution, or no variation.
        """
        asked = read_fields({"variations": variations}, ProofRequest)
        return self._link.post_once_only(f"{locate_analysis(analysis)}/proof", Proof, asked)

    def proof(self, analysis: AnalysisLike) -> Proof:
        """How many replays failed again, in which scenarios, as far as results are in.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
        """
        return self._link.get(f"{locate_analysis(analysis)}/proof", Proof)

    def wait_for_proof(
        self, analysis: AnalysisLike, poll_s: float = 0.3, timeout_s: float | None = None
    ) -> Proof:
        """The proof once all of its replays have ended; `prove` comes first.

        Raises:
            NotFound: no such analysis.
            Conflict: it is not done.
            WaitTimeout: they have not ended in time; they go on all the same.
        """
        place = locate_analysis(analysis).removeprefix("/analyses/")
        return wait_until(
            lambda: self.proof(analysis),
            lambda seen: seen.done,
            poll_s,
            timeout_s,
            lambda _seen: f"The proof of analysis {place}",
        )


DATA = "report.json"


FILE = re.compile(r"report\.(html|json)|(tables|pictures)/[a-z0-9-]+\.(csv|svg)")


ALSO = frozenset({"paper.md", "paper.json", "claims.json"})
"""Files that callers add to a report: a page, its numbers, and the claims in it."""


WITHIN_S = 600.0
"""Twenty campaigns with all of their pictures take a while."""


MAX_FILES = 10_000


MAX_BYTES = 1 << 28
"""Of all files together. A report of twenty campaigns with all pictures has some 10 MB."""


DAMAGED = (
    BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    OSError,
    RuntimeError,
    NotImplementedError,
    ValueError,  # encrypted, or packed in another way
)


AGAIN = "Ask for it again; if it is so every time, use one version of eigenfail on both sides."


UNUSUAL = (
    "Nothing was written. Make sure that the address is that of an eigenfail service that you"
    " trust, of the same version."
)


OVERWRITE = "Choose another folder, or give force=True (on the command line --force)."


NOTHING: Mapping[str, bytes] = MappingProxyType({})


def fetch_report(link: Link, campaigns: CampaignsLike) -> dict[str, bytes]:
    """The files of a report by name; raises as `Client.report` does."""
    ids = find_campaign_ids(campaigns)
    asked = httpx2.QueryParams({"campaign": list(ids), "format": "zip"})
    return unpack(link.get_bytes("/report", asked, WITHIN_S))


def write_report(
    files: Mapping[str, bytes], folder: Path, also: Mapping[str, bytes] = NOTHING
) -> Report:
    """Write a report and further files into a folder; raises as `Client.report` does."""
    report = decode(files[DATA], Report)
    try:
        _write_all({**files, **also}, folder)
    except OSError as error:
        problem = f"The report cannot be written to {folder}: {error.strerror}."
        raise ServiceError(problem, "Choose a folder that you can write to.") from error
    return report


def check_folder(folder: Path, force: bool) -> None:
    """Refuse to overwrite files of an existing folder.

    Raises:
        InvalidValue: something is there that may not be overwritten.
    """
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if folder.exists() and (alien := _find_foreign(folder)):
        problem = f"{folder} already exists and contains files of no report: {alien}."
        raise InvalidValue("output", problem, "Choose a folder that does not exist.")
    if folder.exists() and not force:
        problem = f"{folder} already contains a report."
        raise InvalidValue("output", problem, OVERWRITE)


def _find_foreign(folder: Path) -> str:
    """Return the name of a file that no report wrote; empty if there is none."""
    if not folder.is_dir():
        return "it is not a folder"
    files = (path for path in folder.rglob("*") if not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in files)
    return next((name for name in names if not (FILE.fullmatch(name) or name in ALSO)), "")


def unpack(bundle: bytes) -> dict[str, bytes]:
    """Return the files of a report by name, from the ZIP archive that a service sent.

    Names and sizes are looked at before anything is unpacked. An archive that claims too little is
    not read beyond its claim, and is damaged by its checksum.

    Raises:
        ProtocolError: the archive is no report, is damaged, or holds other or larger files.
    """
    if not is_zipfile(io.BytesIO(bundle)):
        raise _not_a_report()
    try:
        with ZipFile(io.BytesIO(bundle)) as archive:
            names = archive.namelist()
            _check_names(names)
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                size = f"{MAX_BYTES / 2**20:g} MiB"
                raise ProtocolError(f"The archive unpacks to more than {size}.", UNUSUAL)
            files = {name: archive.read(name) for name in names}
    except DAMAGED as error:
        raise ProtocolError(f"The archive is damaged: {error}.", AGAIN) from error
    if DATA not in files:
        raise _not_a_report()
    return files


def _check_names(names: Sequence[str]) -> None:
    if len(names) > MAX_FILES:
        raise ProtocolError(f"The archive has more than {MAX_FILES} files.", UNUSUAL)
    if len(set(names)) < len(names):
        raise ProtocolError("The archive contains a duplicate file.", AGAIN)
    for name in names:
        if not FILE.fullmatch(name):
            problem = f"The archive holds {name[:200]!r}, which is not part of a report."
            raise ProtocolError(problem, UNUSUAL)


def _not_a_report() -> ProtocolError:
    return ProtocolError("The response is not a report.", "Use one release on both sides.")


def _write_all(files: Mapping[str, bytes], folder: Path) -> None:
    """Write all files or nothing: they are written elsewhere, and come in by one renaming.

    Raises:
        OSError: they cannot be written.
    """
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        made, old = beside / "made", beside / "old"
        for name, content in files.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)
        if folder.exists():
            folder.rename(old)
        try:
            made.rename(folder)
        except OSError:
            if old.exists():
                old.rename(folder)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)
