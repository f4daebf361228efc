"""Conformance suites, one for each contract, for authors of plug-ins."""

from collections.abc import Iterator
from contextlib import contextmanager

from eigenfail.errors import describe_error


def expect(kept: bool, broken: str) -> None:
    """Require a condition of the contract.

    Raises:
        AssertionError: it was broken; the message says how.
    """
    if not kept:
        raise AssertionError(broken)


@contextmanager
def expect_error(kind: type[Exception], broken: str) -> Iterator[None]:
    """Require an error of a kind.

    Raises:
        AssertionError: nothing was raised, or something else.
    """
    try:
        yield
    except kind:
        return
    except Exception as error:
        raise AssertionError(f"{broken} It raised {describe_error(error)}") from error
    raise AssertionError(f"{broken} It raised nothing.")
