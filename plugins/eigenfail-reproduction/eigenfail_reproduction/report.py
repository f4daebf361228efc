"""A service's report on the campaigns, which stands in the folder beside the paper's tables."""

import io
import re
from collections.abc import Sequence
from zipfile import BadZipFile, ZipFile

import httpx2

from eigenfail.client import Client
from eigenfail.errors import NotFound, ProtocolError

FILE = re.compile(
    r"report\.(?:html|json)|paper\.(?:md|json)|claims\.json"
    r"|(?:tables|pictures)/[a-z0-9-]+\.(?:csv|svg)"
)
"""Names of the files of the folder. Files of other names are never read or replaced."""

WITHIN_S = 600.0
"""The pictures of a dozen campaigns take a while."""


def fetch_report(client: Client, campaigns: Sequence[int]) -> dict[str, bytes]:
    """Return the files of a report on campaigns, by name; none if the service makes no reports.

    Another plug-in brings reports, which need not be installed where the service runs.

    Raises:
        ProtocolError: the answer is not an archive.
    """
    asked = httpx2.QueryParams({"campaign": list(campaigns), "format": "zip"})
    try:
        archive = client.link.get_bytes("/report", asked, WITHIN_S)
    except NotFound:
        return {}
    try:
        with ZipFile(io.BytesIO(archive)) as files:
            return {name: files.read(name) for name in files.namelist() if FILE.fullmatch(name)}
    except BadZipFile as error:
        raise ProtocolError("The report is damaged.", "Run the command again.") from error
