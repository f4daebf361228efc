"""The code that ran the episodes of campaigns, as workers describe it, recorded with them."""

from collections.abc import Mapping

from eigenfail.errors import NotFound
from eigenfail.fingerprints import CODE, select_code
from eigenfail_services.store.campaigns import CampaignStore


class CodeRecorder:
    """Records the fingerprints of the code of the workers that a campaign's episodes are leased to.

    Args:
        campaigns: are written to.
    """

    def __init__(self, campaigns: CampaignStore) -> None:
        self._campaigns = campaigns
        self._pending: dict[tuple[int, frozenset[tuple[str, str]]], None] = {}
        self._written: set[tuple[int, frozenset[tuple[str, str]]]] = set()

    def note(self, campaign: int, versions: Mapping[str, str]) -> None:
        """Note that a worker with these versions gets episodes of a campaign."""
        code = frozenset(item for item in versions.items() if item[0].startswith(CODE))
        if code and (campaign, code) not in self._written:
            self._pending[campaign, code] = None

    def write(self) -> None:
        """Write the fingerprints that were noted since the last call.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        while self._pending:
            campaign, noted = key = next(iter(self._pending))
            self._write_code(campaign, dict(noted))
            self._written.add(key)
            del self._pending[key]

    def _write_code(self, campaign: int, versions: Mapping[str, str]) -> None:
        try:
            spec = self._campaigns.get(campaign).spec
        except NotFound:
            return
        if code := select_code(versions, spec):
            self._campaigns.add_code(campaign, code)

    def forget(self, campaign: int) -> None:
        """Forget the fingerprints of a campaign that has ended."""
        self._written = {key for key in self._written if key[0] != campaign}
