"""The client of an eigenfail service."""

from typing import TYPE_CHECKING, Any

from eigenfail.client.client import Client

if TYPE_CHECKING:
    from eigenfail.client.asynchronous import AsyncClient

__all__ = ["AsyncClient", "Client"]


def __getattr__(name: str) -> Any:
    """The asynchronous client, loaded by those alone who use it.

    Raises:
        AttributeError: there is no such name.
    """
    if name != "AsyncClient":
        raise AttributeError(f"module 'eigenfail.client' has no attribute '{name}'")
    from eigenfail.client.asynchronous import AsyncClient

    return AsyncClient
