"""How a conformance check speaks."""

from collections.abc import Iterator
from contextlib import contextmanager


def expect(kept: bool, broken: str) -> None:
    """Hold an implementation to its contract.

    Raises:
        AssertionError: it was broken; the message says how.
    """
    if not kept:
        raise AssertionError(broken)


@contextmanager
def expect_error(kind: type[Exception], broken: str) -> Iterator[None]:
    """Hold an implementation to raising an error of that kind.

    Raises:
        AssertionError: nothing was raised, or something else.
    """
    try:
        yield
    except kind:
        return
    except Exception as error:
        raise AssertionError(f"{broken} It raised {type(error).__name__}: {error}") from error
    raise AssertionError(f"{broken} It raised nothing.")
