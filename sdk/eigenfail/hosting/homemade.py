"""Plug-ins that are not installed: registered for one service alone, from a folder of its own."""

import os
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path

from eigenfail import plugins
from eigenfail.errors import InvalidValue

METADATA = "Metadata-Version: 2.1\nName: eigenfail-homemade\nVersion: 0.0\n"
NAME = "eigenfail_homemade-0.0.dist-info"
INSTALLED = frozenset(Path(folder) for folder in sysconfig.get_paths().values())
"""Where every process of this Python looks anyway."""


def register(folder: Path, planners: Mapping[str, str]) -> tuple[Path, ...]:
    """Write down where planners are; the folders from which a service can import them.

    Args:
        folder: to write to.
        planners: module:Class by the name that campaigns give; modules are found where this process
            finds them, and what is in no file is refused.

    Raises:
        InvalidValue: a name is taken, or there is nothing at a place.
    """
    if not planners:
        return ()
    for name, place in planners.items():
        if not name.isidentifier() or name in plugins.names(plugins.PLANNERS):
            remedy = "Choose another name, of letters, digits and underscores."
            raise InvalidValue("planners", f"'{name}' is no name, or is taken.", remedy)
        plugins.load_class(place)
    listed = "\n".join(f"{name} = {place}" for name, place in planners.items())
    notes = folder / NAME
    notes.mkdir(parents=True, exist_ok=True)
    (notes / "METADATA").write_text(METADATA)
    (notes / "entry_points.txt").write_text(f"[{plugins.PLANNERS}]\n{listed}\n")
    homes = {home_of(place) for place in planners.values()} - {Path.cwd(), *INSTALLED}
    return folder, Path.cwd(), *sorted(homes)


def home_of(place: str) -> Path:
    """The folder from which the module of a module:Class that was loaded here is imported.

    Raises:
        InvalidValue: it is in no file that another process can import, such as a notebook's cell.
    """
    module = place.partition(":")[0]
    spec = sys.modules[module].__spec__
    if module == "__main__" or spec is None or not spec.has_location:
        remedy = "Write the class to a file, such as my_planner.py, and name my_planner:MyPlanner."
        raise InvalidValue("planners", f"no service can import '{place}'.", remedy)
    depth = module.count(".") + bool(spec.submodule_search_locations)
    return Path(str(spec.origin)).absolute().parents[depth]


def python_path(folders: tuple[Path, ...]) -> dict[str, str]:
    """The variable by which a process imports from these folders, beside what it finds anyway."""
    if not folders:
        return {}
    before = os.environ.get("PYTHONPATH", "")
    return {"PYTHONPATH": os.pathsep.join(filter(None, [*map(str, folders), before]))}
