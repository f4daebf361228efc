"""Keyset pages: stable while rows arrive, as quick on the last page as on the first."""

from typing import Generic, TypeVar

import msgspec

Item = TypeVar("Item")


class Page(msgspec.Struct, Generic[Item], frozen=True):
    """Some items, and the cursor that asks for those behind them (None at the end)."""

    items: tuple[Item, ...]
    next: int | None = None
