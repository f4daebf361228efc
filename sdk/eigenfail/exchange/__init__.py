"""Exchange with other tools: recorded tracks come in, single episodes go out.

Plug-ins bring the formats of single episodes, by entry points of the group `eigenfail.exports`.
"""

from contextlib import suppress

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InputError, InvalidValue, UnknownName
from eigenfail.exchange.recording import EgoControl, RecordingFormat

KNOWN = ("openscenario", "mcap", "gif")
"""Formats that a plug-in of this repository brings."""

PACKAGE = "eigenfail-exchange"
"""The plug-in, under plugins/."""


def list_formats() -> dict[str, RecordingFormat]:
    """Return the formats that can be written here by name, those of `KNOWN` first.

    One that cannot be loaded is left out: who asks for it is told why.
    """
    names = sorted(plugins.names(plugins.EXPORTS), key=_rank)
    found = {}
    for name in names:
        with suppress(EigenfailError):
            found[name] = find_format(name)
    return found


def _rank(name: str) -> int:
    return KNOWN.index(name) if name in KNOWN else len(KNOWN)


def find_format(name: str) -> RecordingFormat:
    """Return the format of a name.

    Raises:
        UnknownName: there is no such format.
        InvalidValue: its package is not installed here, or cannot be loaded.
    """
    installed = plugins.names(plugins.EXPORTS)
    if name not in installed:
        raise _describe_absence(name, installed)
    found = plugins.load(plugins.EXPORTS, name)
    if not isinstance(found, RecordingFormat):
        kind = type(found).__name__
        problem = f"'{name}' is a {kind}, not a RecordingFormat."
        raise InvalidValue("format", problem, "Fix its package.")
    return found


def _describe_absence(name: str, installed: list[str]) -> InputError:
    package = f"package {PACKAGE}, which is not installed where the service runs"
    if name in KNOWN:
        there = f"Installed formats: {', '.join(installed) or 'none'}."
        remedy = f"{there} Run there, in a clone: pip install plugins/{PACKAGE}"
        return InvalidValue("format", f"'{name}' is in the {package}.", remedy)
    problem = f"'{name}' is not known."
    if missing := [each for each in KNOWN if each not in installed]:
        problem += f" The {package}, brings {', '.join(missing)}."
    return UnknownName("format", name, installed, problem)


def check_format(name: str, ego: EgoControl) -> RecordingFormat:
    """Return the format of a name, in which the ego can be driven as is asked for.

    Raises:
        UnknownName: there is no such format.
        InvalidValue: the format leaves nothing to a controller, or cannot be written here.
    """
    found = find_format(name)
    if ego is EgoControl.CONTROLLER and not found.has_controller:
        others = [other for other, each in list_formats().items() if each.has_controller]
        problem = f"{name} shows what happened, and has no controller."
        remedy = f"Use the format {' or '.join(others)}." if others else ""
        raise InvalidValue("ego", problem, remedy)
    return found
