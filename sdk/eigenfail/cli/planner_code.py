"""What code a suite's planners consist of on this machine, as a short fingerprint."""

from collections.abc import Iterator
from hashlib import sha256
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites import Suite
from eigenfail.values import CampaignSpec

LENGTH = 12
NOT_CODE = "__pycache__"


def fingerprint(suite: Suite) -> str:
    """Different where the world that a suite's episodes run in may behave differently.

    Made of all files in the packages of its planners, scenarios and simulators, of the versions of
    all that is installed, and of the planners' settings. Code that lies elsewhere is not seen.

    Raises:
        UnknownName: a plug-in that is not installed here.
        InvalidValue: a package whose code cannot be found.
    """
    digest = sha256()
    for package in sorted({name for each in suite.members for name in packages(each.spec)}):
        for name, content in files(package):
            digest.update(f"{package}/{name}\0{len(content)}\0".encode() + content)
    digest.update("\n".join(installed()).encode())
    settings = [
        (each.name, each.spec.planner, each.spec.planner_settings) for each in suite.members
    ]
    digest.update(msgspec.json.encode(settings, order="sorted"))
    return digest.hexdigest()[:LENGTH]


def packages(spec: CampaignSpec) -> Iterator[str]:
    """The top packages of what an episode is made of.

    Raises:
        UnknownName: a plug-in that is not installed here.
    """
    if spec.simulator == functions.SIMULATOR:
        functions.require_module(spec.planner)
        yield spec.planner.partition(":")[0].partition(".")[0]
        return
    if spec.simulator == bridges.SIMULATOR:
        return
    parts = {
        plugins.PLANNERS: spec.planner,
        plugins.SCENARIOS: spec.scenario,
        plugins.SIMULATORS: spec.simulator,
    }
    for group, name in parts.items():
        if name not in plugins.registered(group):
            raise UnknownName(group.removeprefix("eigenfail."), name, plugins.names(group))
        yield plugins.registered(group)[name].module.partition(".")[0]


def files(package: str) -> Iterator[tuple[str, bytes]]:
    """The files of a package, or the one of a module, with their places in it; in order.

    Raises:
        InvalidValue: it is not found.
    """
    found = find_spec(package)
    folders = [Path(place) for place in (found and found.submodule_search_locations) or ()]
    if found is None or not (folders or found.origin):
        raise InvalidValue(
            "planner", f"the code of '{package}' is not found here.", "Give --planner-version."
        )
    if not folders:
        yield "", Path(found.origin or "").read_bytes()
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            if file.is_file() and NOT_CODE not in file.parts:
                yield file.relative_to(folder).as_posix(), file.read_bytes()


def installed() -> list[str]:
    """All that is installed here, with its version."""
    return sorted({f"{each.metadata['Name']}=={each.version}" for each in distributions()})
