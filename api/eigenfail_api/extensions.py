"""Extensions: routes, pages and navigation entries that other distributions add."""

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import msgspec
from fastapi import APIRouter
from fastapi.routing import APIRoute

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values.access import Scope
from eigenfail_api.dashboard.rendering import CampaignFile, NavigationEntry, add_templates

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Extension:
    """An extension, which an entry point of the group `eigenfail.routes` names.

    Attributes:
        routers: routers of FastAPI. Addresses of the REST API begin with `/api/v1`; pages of the
            dashboard are outside the schema.
        templates: package with a folder `templates`; pages name a template `PACKAGE/FILE`.
        navigation: links in the head of every page.
        campaign_files: files about a campaign, which its page offers.
        scopes: least scopes of requests such as "POST /area". Otherwise a viewer may send a GET,
            and everything else requires an administrator.
        recorded: fields of a request's body that the audit log keeps, by type of the body. It
            keeps nothing of other bodies, which may hold secrets.
    """

    routers: tuple[APIRouter, ...]
    templates: str = ""
    navigation: tuple[NavigationEntry, ...] = ()
    campaign_files: tuple[CampaignFile, ...] = ()
    scopes: Mapping[Scope, tuple[str, ...]] = field(default_factory=dict)
    recorded: Mapping[type[msgspec.Struct], tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Add the templates; raise ValueError if their package lacks a folder of templates."""
        if self.templates:
            add_templates(self.templates)


def load_extensions(core: Iterable[APIRouter]) -> tuple[Extension, ...]:
    """Return the installed extensions, sorted by name.

    An extension that cannot be used is logged and left out: the service must work without it.

    Args:
        core: routers of the core, whose addresses no extension may have.
    """
    taken, found = set(list_requests(core)), []
    for name in plugins.names(plugins.ROUTES):
        try:
            extension = plugins.load(plugins.ROUTES, name)
            _check_extension(name, extension, taken)
        except EigenfailError:
            log.exception("The extension '%s' is left out. All else works.", name)
            continue
        # An extension cannot take an address of another extension, either.
        taken |= set(list_requests(extension.routers))
        found.append(extension)
    return tuple(found)


def _check_extension(name: str, extension: object, taken: set[str]) -> None:
    """Raise InvalidValue unless an extension adds routes only, and opens its own routes only."""
    if not isinstance(extension, Extension):
        problem = f"'{name}' is of the type {type(extension).__name__}, and must be an Extension."
        raise InvalidValue("route", problem, "Fix its package.")
    own = set(list_requests(extension.routers))
    # None would open a route to callers without a key.
    if strange := [each for each in extension.scopes if each not in [*Scope]]:
        problem = f"'{name}' has a scope {strange[0]!r}, and must use those of `Scope`."
        raise InvalidValue("route", problem, "Fix its package.")
    for kind, names in extension.recorded.items():
        if unknown := sorted({*names} - {*kind.__struct_fields__}):
            problem = f"'{name}' records {unknown[0]}, which is no field of {kind.__name__}."
            raise InvalidValue("route", problem, "Fix its package.")
    if both := sorted(own & taken):
        raise InvalidValue("route", f"'{name}' has {both[0]}, which exists.", "Fix its package.")
    if others := sorted({line for lines in extension.scopes.values() for line in lines} - own):
        problem = f"'{name}' sets the scope of {others[0]}, which is not its route."
        raise InvalidValue("route", problem, "Fix its package.")


def list_requests(routers: Iterable[APIRouter]) -> Iterator[str]:
    """Yield method and address of each route, such as "GET /campaigns/{campaign}"."""
    for router in routers:
        for route in router.routes:
            if isinstance(route, APIRoute):
                yield from (f"{method} {route.path_format}" for method in route.methods or ())
