"""Functions of a user's module that a campaign may name: policies and margins.

A campaign comes from a request, and to import is to run. So the same rules apply as to functions
under test (`eigenfail.functions`): the operator lists the modules, and only functions that their
authors have declared are called.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Generic, TypeVar

from eigenfail import functions
from eigenfail.errors import InvalidValue, describe_error

PACKAGE = __name__.partition(".")[0]

Called = TypeVar("Called", bound=Callable[..., Any])


class Declared(Generic[Called]):
    """A function that its author has declared to be a policy or a margin.

    Args:
        function: the function to call.
        kind: "policy" or "margin".
    """

    def __init__(self, function: Called, kind: str) -> None:
        self.function = function
        self.kind = kind


def policy(function: Called) -> Declared[Called]:
    """Declare a function that makes the policy of one episode; see `policies.PolicyMaker`."""
    return Declared(function, "policy")


def margin(function: Called) -> Declared[Called]:
    """Declare a function `(env, info)` that returns the distance to a failure.

    The function is called at the start of an episode and after each step. It gets the environment
    without wrappers, and the `info` that `reset` or `step` returned. It returns a finite number in
    any unit; 0 or less is a failure.
    """
    return Declared(function, "margin")


def refuse_unlisted(place: str, field: str) -> None:
    """Refuse a function that may not be imported here; nothing is run.

    Args:
        place: as `module:function`.
        field: name of the field, for the error.

    Raises:
        InvalidValue: the place is not of this form, or the operator has not listed its module.
    """
    if not functions.PLACE.fullmatch(place):
        problem = f"'{place}' is not of the form module:function."
        raise InvalidValue(field, problem, "Write it as my_policy:brake.")
    if place.partition(":")[0].partition(".")[0] != PACKAGE:
        refuse_unlisted_module(place.partition(":")[0], field)


def refuse_unlisted_module(module: str, field: str) -> None:
    """Refuse a module that the operator of this process has not listed.

    Raises:
        InvalidValue: neither the module nor a package around it is in the list.
    """
    if not functions.is_listed(module):
        variable = functions.ALLOWED_VARIABLE
        remedy = (
            f"Start the service with `eigenfail up --functions {module}`, after stopping one that "
            f"runs. Without a service, begin the command with {variable}={module}."
        )
        problem = f"'{module}' is not in the list of modules that may be imported here."
        raise InvalidValue(field, problem, remedy)


def load_declared(place: str, kind: str, field: str) -> Callable[..., Any]:
    """Return the declared function at a place.

    Args:
        place: as `module:function`.
        kind: "policy" or "margin".
        field: name of the field, for the error.

    Raises:
        InvalidValue: it is not listed, cannot be imported, does not exist, or is not declared.
    """
    refuse_unlisted(place, field)
    module_name, name = place.split(":")
    functions.look_in_this_folder()
    try:
        # Before the import: a module that declares nothing is not run.
        spec = find_spec(module_name)
        source = Path(spec.origin) if spec and spec.origin else None
        is_meant = source is not None and PACKAGE in source.read_text("utf-8", "replace")
        found = getattr(import_module(module_name), name, None) if is_meant else None
    except (Exception, SystemExit) as error:
        problem = f"'{place}' cannot be imported: {describe_error(error)}."
        raise InvalidValue(field, problem, "Mend the module.") from error
    if source is None:
        problem = f"'{place}' cannot be imported: there is no module '{module_name}'."
        remedy = "Start the service in the folder of the module, or install it with the workers."
        raise InvalidValue(field, problem, remedy)
    if not isinstance(found, Declared) or found.kind != kind:
        remedy = f"Define it with @{kind} of {PACKAGE}.declared above it."
        raise InvalidValue(field, f"'{place}' is not declared to be a {kind}.", remedy)
    function: Callable[..., Any] = found.function
    return function
