"""With what episodes are run: where it differs, so may the last bit of a result."""

import platform
import re
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path

from eigenfail.values.worker import Versions

NUMERICS = ("eigenfail", "gymnasium", "highway-env", "msgspec", "numpy", "osqp", "scipy")
GROUP = "eigenfail."
NOTHING = "none"
PROCESSORS = Path("/proc/cpuinfo")


@cache
def versions() -> dict[str, str]:
    """By name: Python, machine, processor, what computes, every package with a plug-in of ours."""
    found = {
        "python": platform.python_version(),
        "machine": f"{platform.machine()} {sys.platform} {platform.libc_ver()[1]}".strip(),
        "processor": processor(),
    }
    return found | {
        name: of for name in sorted({*NUMERICS, *with_plugins()}) if (of := pinned(name))
    }


def processor() -> str:
    """Its type, by which libraries choose how they sum; empty where nobody says it."""
    with suppress(OSError):
        found = re.search(r"^model name\s*:\s*(.+)$", PROCESSORS.read_text(), re.MULTILINE)
        return found[1] if found else ""
    return ""


def pinned(package: str) -> str:
    """The version of a package; empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def with_plugins() -> set[str]:
    """The packages in which simulators, scenarios, planners or methods are."""
    return {
        found.name
        for found in distributions()
        if any(point.group.startswith(GROUP) for point in found.entry_points)
    }


def differences(then: Versions, now: Versions) -> tuple[str, ...]:
    """What is not as it was, a phrase for each name; one side alone may know a name."""
    names = sorted(then.keys() | now.keys())
    return tuple(
        f"{name} {then.get(name) or NOTHING} then, {now.get(name) or NOTHING} now"
        for name in names
        if then.get(name) != now.get(name)
    )
