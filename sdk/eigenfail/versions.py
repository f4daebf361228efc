"""Versions of what runs episodes: where they differ, the last bits of results may differ."""

import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, version
from itertools import pairwise

from eigenfail.processes import find_processor
from eigenfail.values.campaign import Campaign
from eigenfail.values.operations import Versions

PACKAGE = "eigenfail"
NUMERICS = ("eigenfail", "gymnasium", "highway-env", "msgspec", "numpy", "osqp", "scipy")
LEARNERS = ("scikit-learn", "stable-baselines3", "torch")
GROUP = "eigenfail."
NOTHING = "none"


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python, machine, processor, numerical and plug-in packages by name."""
    found = {
        "python": platform.python_version(),
        "machine": f"{platform.machine()} {sys.platform} {platform.libc_ver()[1]}".strip(),
        "processor": find_processor(),
    }
    return found | {
        name: of for name in sorted({*NUMERICS, *with_plugins()}) if (of := read_version(name))
    }


@cache
def learner_versions() -> dict[str, str]:
    """Return `versions` and those of the packages that decide what a learner proposes, by name."""
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
    """Return a sentence for each time that services of other versions took a campaign over.

    Nothing is said of a takeover before the first result: no result of other versions is in it.
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
