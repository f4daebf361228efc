"""The compiled copy of the episode loop, which is imported in place of its sources.

`eigenfail_workers.compiler` makes the copy from the Python sources here. The copy is stored and
found by a digest of all sources that it was made from. If any source changes, the modules are
interpreted until they are compiled again. With EIGENFAIL_INTERPRETED=1 they are always interpreted,
for a debugger.
"""

import hashlib
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

PACKAGE = "eigenfail_workers"
MODULES = (
    "closed_loop",
    "episode",
    "faults",
    "motion",
    "perception",
    "measures.encounters",
    "measures.geometry",
    "measures.importance",
    "measures.recorder",
    "measures.signals",
    "noise.deviations",
    "noise.sources",
    "planners.steering",
    "planners.rulebook.candidates",
    "planners.rulebook.changes",
    "planners.rulebook.planner",
    "planners.rulebook.driving_modes",
    "planners.rulebook.lanes",
    "planners.rulebook.refine",
    "planners.rulebook.quadratic_program",
    "planners.rulebook.rules",
    "planners.rulebook.tracker",
    "planners.rulebook.traffic",
    "scenarios.traffic",
    "simulators.highway",
    "simulators.point_mass",
    "simulators.scripted_world",
)
"""Modules that are compiled. Classes of msgspec cannot be: they are in modules of their own."""

SHARED = f"{PACKAGE}__mypyc"
"""The library that holds the code of all modules."""

INTERPRETED_VARIABLE = "EIGENFAIL_INTERPRETED"

_FOLDER = Path(__file__).parent
COPIES = _FOLDER / "__compiled__"


class CompiledModules(MetaPathFinder):
    """Finds the modules in a folder of compiled ones."""

    def __init__(self, folder: Path) -> None:
        names = [SHARED, *(f"{PACKAGE}.{name}" for name in MODULES)]
        suffix = EXTENSION_SUFFIXES[0]
        self._files = {name: folder / f"{name.replace('.', '/')}{suffix}" for name in names}

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None = None,  # noqa: ARG002 - the contract's
        target: ModuleType | None = None,  # noqa: ARG002 - the contract's
    ) -> ModuleSpec | None:
        """Return the spec of a compiled module; None for modules that are not compiled."""
        file = self._files.get(fullname)
        return None if file is None else spec_from_file_location(fullname, file)


def find_copy() -> Path:
    """Return the folder for the modules compiled from the present sources, which may not exist.

    Its name depends on all sources that the compiled code was checked against, and on this version
    of Python.
    """
    # The suffix names the version of Python and the platform that an extension is built for.
    found = hashlib.sha256(EXTENSION_SUFFIXES[0].encode())
    for package in (_FOLDER, find_package("eigenfail.values")):
        for source in sorted(package.rglob("*.py")):
            found.update(source.relative_to(package).as_posix().encode())
            found.update(source.read_bytes())
    return COPIES / found.hexdigest()[:16]


def use_compiled_modules() -> None:
    """Import the compiled modules from now on, unless there are none or they are switched off."""
    # To find the copy, all sources are read. A process that has no copy at all need not do so.
    if os.environ.get(INTERPRETED_VARIABLE) or not COPIES.is_dir():
        return
    folder = find_copy()
    if folder.is_dir():
        # Before the finder of files, which would find the sources under the same names.
        sys.meta_path.insert(0, CompiledModules(folder))


def find_package(name: str) -> Path:
    """Return the folder of a package."""
    spec = find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"No package named '{name}'")
    return Path(spec.submodule_search_locations[0])
