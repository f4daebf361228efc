"""Versions of the packages that run episodes; if they differ, last bits of results may differ.

The code of plug-ins changes more often than their version. So each package also has a fingerprint
of its code, which is equal for equal files.
"""

import platform
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, distributions, version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.processes import find_processor
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.operations import Versions
from eigenfail.worlds import world_of

PACKAGE = "eigenfail"
NUMERICS = ("eigenfail", "gymnasium", "highway-env", "msgspec", "numpy", "osqp", "scipy")
LEARNERS = ("scikit-learn", "stable-baselines3", "torch")
GROUP = "eigenfail."
NOTHING = "none"

LENGTH = 12
"""Hexadecimal digits of a fingerprint."""

CODE = "code of "
"""What the name of a fingerprint begins with among versions."""

LARGEST_BYTES = 64_000_000
"""Largest package that a worker reads as it starts. [bytes]"""

# Compiled files differ between machines whose code is the same.
_NOT_CODE = "__pycache__"
_GROUPS = (plugins.PLANNERS, plugins.SCENARIOS, plugins.SIMULATORS)


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python, machine, processor, numerical and plug-in packages by name."""
    found = {
        "python": platform.python_version(),
        "machine": f"{platform.machine()} {sys.platform} {platform.libc_ver()[1]}".strip(),
        # Kernels of numerical libraries, and so the last bits, are chosen by the processor.
        "processor": find_processor(),
    }
    return found | {
        name: of for name in sorted({*NUMERICS, *with_plugins()}) if (of := read_version(name))
    }


@cache
def learner_versions() -> dict[str, str]:
    """Return `versions`, and versions of packages that affect a learner's proposals, by name."""
    return versions() | {name: of for name in LEARNERS if (of := read_version(name))}


def read_version(package: str) -> str:
    """Return the version of an installed package; empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def with_plugins() -> set[str]:
    """Return the names of the installed packages that register plug-ins of eigenfail."""
    return {
        found.name
        for found in distributions()
        if any(point.group.startswith(GROUP) for point in found.entry_points)
    }


def differences(then: Versions, now: Versions) -> tuple[str, ...]:
    """Return a phrase for each name whose version differs; either side may lack a name."""
    names = sorted(then.keys() | now.keys())
    return tuple(
        f"{name} {then.get(name) or NOTHING} then, {now.get(name) or NOTHING} now"
        for name in names
        if then.get(name) != now.get(name)
    )


def describe_mixed(campaign: Campaign) -> tuple[str, ...]:
    """Return a sentence for each takeover of a campaign by services of other versions.

    A takeover before the first result is left out: the campaign has results of one version only.
    """
    sentences = []
    for before, now in pairwise(campaign.parts):
        if now.results:
            changes = "; ".join(differences(before.versions, now.versions))
            sentences.append(
                f"Campaign {campaign.id} went on with other versions after {now.results:,} "
                f"result{'s' * (now.results != 1)}: {changes}."
            )
    return (*sentences, NOT_OF_ONE_RELEASE) if sentences else ()


NOT_OF_ONE_RELEASE = (
    "What was searched before and after may differ from a campaign that one release ran: run it "
    "again for evidence that can be reproduced."
)


def read_package_files(package: str) -> Iterator[tuple[str, bytes]]:
    """Yield the files of a package or a module in order, each with its path in the package.

    Raises:
        InvalidValue: the package is not found.
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
    """Return the top packages of the code that runs a campaign's episodes.

    Raises:
        UnknownName: a plug-in is not installed here.
    """
    return world_of(spec.simulator).packages(spec)


@cache
def fingerprint_plugins() -> Versions:
    """Return the fingerprints of the packages with planners, scenarios or simulators, by name.

    Packages that are larger than `LARGEST_BYTES`, or that cannot be read, are left out.
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

    If a plug-in is not installed here, all fingerprints are returned. The result is empty if the
    campaign's code is not in a package with plug-ins: a function, or a process behind a bridge.
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
