"""Where the episodes of a file come from, told in the file itself."""

import re
from hashlib import sha256

import msgspec

from eigenfail import __version__
from eigenfail.filters import COLUMNS
from eigenfail.values import AXES, CampaignSpec
from eigenfail_services.exports.selection import Source

NOISE = tuple(f"{axis}_z" for axis in AXES)
"""Columns of the noise: a list of float32 for each episode. [sigma]"""

UNIT = re.compile(r"\[([^]]+)\]$")


class Origin(msgspec.Struct, frozen=True):
    """What a file's metadata says of it.

    Attributes:
        campaign: id of its campaign.
        spec_sha256: of the campaign's spec, see `spec_digest`.
        eigenfail: version that wrote it.
        units: of its columns, where they have one.
    """

    campaign: int
    spec_sha256: str
    eigenfail: str
    units: dict[str, str]


def origin_of(source: Source, *, noise: bool) -> Origin:
    """What a file of these episodes says of itself.

    Raises:
        NotFound: no such campaign.
    """
    spec = source.store.campaigns.get(source.campaign).spec
    units = units_of(source.wanted.columns) | {name: "sigma" for name in NOISE if noise}
    return Origin(source.campaign, spec_digest(spec), __version__, units)


def spec_digest(spec: CampaignSpec) -> str:
    """SHA-256 of a spec as compact JSON with sorted keys: equal for equal specs."""
    return sha256(msgspec.json.encode(spec, order="sorted")).hexdigest()


def units_of(columns: tuple[str, ...]) -> dict[str, str]:
    """The units that columns say at the end of their words, by name."""
    found = {name: UNIT.search(COLUMNS[name].words) for name in columns}
    return {name: unit[1] for name, unit in found.items() if unit}
