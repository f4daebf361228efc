"""Known flaws of the locked packages: asked of pip-audit, and held against the floors beside this.

    make lint

A machine that reaches no advisories is told so, and has the floors alone.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

HERE = Path(__file__).parent
LOCKS = (HERE.parent / "constraints.txt", HERE / "locks" / "torch_cuda.txt")
"""Between them they have every package that is installed anywhere."""

FLOORS = HERE / "floors.toml"
PIP_AUDIT = (
    *(sys.executable, "-m", "pip_audit", "--format", "json"),
    *("--no-deps", "--disable-pip", "--progress-spinner", "off", "--timeout", "3"),
)
PATIENCE_S = 120

Pinned = Mapping[str, Version]


def main() -> int:
    """Print what is wrong; 1 if anything is."""
    packages = read_locks(LOCKS)
    floors = tomllib.loads(FLOORS.read_text("utf-8"))["floors"]
    flaws = [*too_old(packages, floors), *published(asked(packages))]
    print(*flaws, sep="\n", end="\n" if flaws else "")
    print(f"{len(packages)} packages, {len(floors)} floors, {len(flaws)} flaws.")
    return 1 if flaws else 0


def read_locks(paths: Iterable[Path]) -> Pinned:
    """Return the packages of several lock files."""
    return pinned(line for path in paths for line in path.read_text("utf-8").splitlines())


def pinned(lines: Iterable[str]) -> Pinned:
    """Return name and version of each line `name==version`, which hashes may follow.

    A local label is left out: advisories know no `2.13.0+cpu`.
    """
    packages = (Requirement(line.split(" \\")[0]) for line in lines if line[:1].isalnum())
    return {
        canonicalize_name(package.name): Version(
            Version(next(iter(package.specifier)).version).public
        )
        for package in packages
    }


def too_old(packages: Pinned, floors: Mapping[str, tuple[str, str]]) -> Iterator[str]:
    """What lies below its floor."""
    for name, (least, advisory) in floors.items():
        if name in packages and packages[name] < Version(least):
            yield f"{name} {packages[name]}: {advisory}; take {least} or later."


def asked(packages: Pinned) -> Mapping[str, Any]:
    """What pip-audit says of the packages; nothing where it can ask nobody."""
    try:
        with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
            file.writelines(f"{name}=={version}\n" for name, version in packages.items())
            file.flush()
            command = (*PIP_AUDIT, "--requirement", file.name)
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=PATIENCE_S, check=False
            )
        found: Mapping[str, Any] = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, json.JSONDecodeError):
        print("pip-audit reaches no advisories from here: the floors have to do.")
        return {"dependencies": ()}
    skipped = sum("skip_reason" in package for package in found["dependencies"])
    print(f"pip-audit knows {len(found['dependencies']) - skipped} of the packages from here.")
    return found


def published(found: Mapping[str, Any]) -> Iterator[str]:
    """The flaws in pip-audit's answer."""
    for package in found["dependencies"]:
        for flaw in package.get("vulns", ()):
            remedy = " or ".join(flaw["fix_versions"]) or "another package"
            yield f"{package['name']} {package['version']}: {flaw['id']}; take {remedy}."


if __name__ == "__main__":
    sys.exit(main())
