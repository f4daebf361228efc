"""From `module:function` to the function that is declared under that name."""

from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from eigenfail.errors import InvalidValue
from eigenfail.functions import FunctionUnderTest, look_in_this_folder, not_found, refuse_unlisted
from eigenfail_workers.functions.telling import last_line

DECORATORS = "eigenfail.functions"

WRITTEN = "__eigenfail_written_ns__"
"""Kept in a module: when its file had last been written as it was imported here."""


def find(place: str) -> FunctionUnderTest:
    """The function at `module:function`.

    Only what its author declared with `of_trajectory` or `of_batch` is ever called: a campaign
    comes from a request, and must not be able to call whatever can be imported.

    Raises:
        InvalidValue: it may not be run here, cannot be imported, is not there, is not declared, or
            its file was changed after it was imported here.
    """
    refuse_unlisted(place)
    name, attribute = place.split(":")
    found = getattr(_imported(name, place), attribute, None)
    if found is None:
        problem = f"module '{name}' has no '{attribute}'."
        raise InvalidValue("planner", problem, "Correct the name behind the colon.")
    if not isinstance(found, FunctionUnderTest):
        remedy = "Put @of_trajectory or @of_batch of eigenfail.functions above it."
        raise InvalidValue("planner", f"'{place}' is not declared to be under test.", remedy)
    return found


def _imported(name: str, place: str) -> ModuleType:
    look_in_this_folder()
    invalidate_caches()
    try:
        _refuse_strangers(name, place)
        module = import_module(name)
    except InvalidValue:
        raise
    except (Exception, SystemExit) as error:
        raise not_found(place, last_line(error)) from error
    written_ns = _written_ns(module)
    if vars(module).setdefault(WRITTEN, written_ns) != written_ns:
        problem = f"the file of '{name}' was changed after this worker imported it."
        raise InvalidValue("planner", problem, "Start the service again: it runs the old code.")
    return module


def _refuse_strangers(name: str, place: str) -> None:
    """To import a module is to run it: only one that names the decorators' module is.

    Raises:
        InvalidValue: its text does not.
        ImportError: there is no such module.
    """
    spec = find_spec(name)
    if spec is None:
        raise ModuleNotFoundError(f"No module named '{name}'")
    source = spec.origin if spec.has_location else None
    if source is None or DECORATORS not in Path(source).read_text("utf-8", "replace"):
        remedy = f"Import of_trajectory or of_batch from {DECORATORS} in it."
        raise InvalidValue("planner", f"'{place}' is in no module of functions.", remedy)


def _written_ns(module: ModuleType) -> int:
    file = Path(getattr(module, "__file__", None) or "")
    return file.stat().st_mtime_ns if file.is_file() else 0
