"""Lists that go on: the addresses of their pages."""

from typing import NamedTuple


class Pager(NamedTuple):
    """Where one is in a list.

    Attributes:
        address: of this page.
        newest: the address of the first page; None on it.
        older: the address of the next one, if there is one.
    """

    address: str
    newest: str | None
    older: str | None


def pager(address: str, before: int | None, following: int | None) -> Pager:
    """Of the page that begins below a cursor, and the cursor of the next one."""
    return Pager(
        page_of(address, before),
        page_of(address, None) if before else None,
        page_of(address, following) if following else None,
    )


def page_of(address: str, before: int | None) -> str:
    """A list, from a cursor on."""
    return f"{address}?before={before}" if before else address
