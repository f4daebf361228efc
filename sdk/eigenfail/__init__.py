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

# Values know nothing of tables, pages, diagrams and pandas; here they find who converts them.
_CONVERTERS = {
    "html": ("eigenfail.presentation.notebook", "to_html"),
    "pandas": ("eigenfail.frames", "to_pandas"),
    "numpy": ("eigenfail.frames", "to_numpy"),
    "arrow": ("eigenfail.frames", "to_arrow"),
    "plot": ("eigenfail.presentation.plots", "plot"),
}


def convert(value: object, form: str, *options: object) -> Any:
    """Return a value as `html`, as a `plot`, or as a table of `pandas`, `numpy` or `arrow`."""
    module, function = _CONVERTERS[form]
    return getattr(import_module(module), function)(value, *options)


def __getattr__(name: str) -> Any:
    """One of the names in `__all__`.

    Raises:
        AttributeError: there is no such name.
    """
    if name not in _PLACES:
        raise AttributeError(f"module 'eigenfail' has no attribute '{name}'")
    module, attribute = _PLACES[name]
    return getattr(import_module(module), attribute)
