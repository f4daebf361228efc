"""Many campaigns at once: all of them are in order, or none is launched."""

from collections.abc import Sequence
from typing import Any

from eigenfail.contracts import Store
from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.values import CampaignSpec
from eigenfail.wire.drafts import MOST_AT_ONCE
from eigenfail_services.campaigns.drafts import read_draft


def read_many(given: Sequence[Any], store: Store) -> list[CampaignSpec]:
    """The campaigns that a list asks for, once every one of them could be launched.

    Raises:
        UnknownName: one has a field, plug-in or setting that does not exist; its place is named.
        InvalidValue: one has a value that cannot be; or there are none, or too many.
    """
    if not 1 <= len(given) <= MOST_AT_ONCE:
        problem = f"the list has {len(given)} campaigns, not 1 to {MOST_AT_ONCE}."
        remedy = "Send them in several requests." if given else "Name at least one."
        raise InvalidValue("", problem, remedy)
    return [read_item(item, place, store) for place, item in enumerate(given)]


def read_item(item: Any, place: int, store: Store) -> CampaignSpec:
    """One of them; its problems are told with its place."""
    where = f"[{place}]"
    if not isinstance(item, dict):
        raise InvalidValue(where, "is not an object with the fields of a campaign.")
    try:
        return read_draft(item, store)
    except InputError as error:
        raise placed(error, where) from error


def placed(error: InputError, where: str) -> InputError:
    """The same error, of a value inside something else."""
    field = f"{where}.{error.field}" if error.field else where
    if isinstance(error, UnknownName):
        return UnknownName(field, error.name, error.known)
    return InvalidValue(field, error.problem.removeprefix(f"{error.field}: "), error.remedy)
