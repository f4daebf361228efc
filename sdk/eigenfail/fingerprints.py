"""Fingerprints of code: the same where the files of a package are the same."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.operations import Versions
from eigenfail.worlds import world_of

LENGTH = 12
"""Hexadecimal digits of a fingerprint."""

CODE = "code of "
"""What the name of a fingerprint begins with among versions."""

LARGEST_BYTES = 64_000_000
"""Largest package that a worker reads as it starts. [bytes]"""

# Compiled files differ between machines whose code is the same.
_NOT_CODE = "__pycache__"
_GROUPS = (plugins.PLANNERS, plugins.SCENARIOS, plugins.SIMULATORS)


def read_package_files(package: str) -> Iterator[tuple[str, bytes]]:
    """Yield the files of a package, or the one of a module, with their places in it, in order.

    Raises:
        InvalidValue: it is not found.
    """
    return ((name, file.read_bytes()) for name, file in _list_files(package))


def _list_files(package: str) -> Iterator[tuple[str, Path]]:
    found = find_spec(package)
    folders = [Path(place) for place in (found and found.submodule_search_locations) or ()]
    if found is None or not (folders or found.origin):
        raise InvalidValue(
            "planner", f"the code of '{package}' is not found here.", "Give --planner-version."
        )
    if not folders:
        yield "", Path(found.origin or "")
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            if file.is_file() and _NOT_CODE not in file.parts:
                yield file.relative_to(folder).as_posix(), file


def list_packages(spec: CampaignSpec) -> Iterator[str]:
    """Return the top packages of what an episode is made of.

    Raises:
        UnknownName: a plug-in that is not installed here.
    """
    return world_of(spec.simulator).packages(spec)


@cache
def fingerprint_plugins() -> Versions:
    """Return the fingerprints of the packages with planners, scenarios or simulators, by name.

    Packages that are larger than `LARGEST_BYTES`, or that cannot be read, have none.
    """
    points = (point for group in _GROUPS for point in plugins.list_entry_points(group).values())
    packages = sorted({point.module.partition(".")[0] for point in points})
    found = {f"{CODE}{package}": _fingerprint_package(package) for package in packages}
    return {name: digest for name, digest in found.items() if digest}


def _fingerprint_package(package: str) -> str:
    with suppress(EigenfailError, ImportError, OSError, ValueError):
        if sum(file.stat().st_size for _, file in _list_files(package)) <= LARGEST_BYTES:
            digest = sha256()
            for name, content in read_package_files(package):
                # With names and lengths: otherwise text that moves from one file to the next
                # would not show.
                digest.update(f"{name}\0{len(content)}\0".encode() + content)
            return digest.hexdigest()[:LENGTH]
    return ""


def select_code(versions: Mapping[str, str], spec: CampaignSpec) -> dict[str, str]:
    """Return the fingerprints, among versions, of the packages that a campaign's episodes need.

    Those of all packages where a plug-in is not installed here; none where the code of the campaign
    is in no package with plug-ins: a function, or a process behind a bridge.
    """
    found = {
        name.removeprefix(CODE): digest
        for name, digest in versions.items()
        if name.startswith(CODE)
    }
    with suppress(EigenfailError, ImportError, ValueError):
        needed = set(list_packages(spec))
        return {package: digest for package, digest in found.items() if package in needed}
    return found
