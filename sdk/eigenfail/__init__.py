"""Finds the rare failures of driving stacks, groups them into modes, proves and prices them."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eigenfail.client import Client
    from eigenfail.hosting.session import Local as local  # noqa: N813 - it reads as a verb

__all__ = ["Client", "local"]

__version__ = version("eigenfail")

# Loaded when they are asked for: the command line has to answer at once.
_PLACES = {
    "Client": ("eigenfail.client", "Client"),
    "local": ("eigenfail.hosting.session", "Local"),
}


def __getattr__(name: str) -> Any:
    """Import and return one of the names in `__all__`.

    Raises:
        AttributeError: the name is unknown.
    """
    if name not in _PLACES:
        raise AttributeError(f"module 'eigenfail' has no attribute '{name}'")
    module, attribute = _PLACES[name]
    return getattr(import_module(module), attribute)
