"""Workers of other releases: who can be let in, and what is said to those who cannot."""

from collections.abc import Mapping

import structlog

from eigenfail.versions import versions
from eigenfail.wire.messages import PROTOCOL, read_foreign_hello

PACKAGE = "eigenfail"

log = structlog.get_logger()


def why_not(protocol: int, theirs: Mapping[str, str]) -> str:
    """Why a worker is not let in; empty if it is.

    It has to speak the same protocol, and to be of the same release but for the last number: that
    one counts corrections, after which the same episodes give the same results.

    Args:
        protocol: that it speaks.
        theirs: versions of what it runs with, by name.
    """
    ours, other = versions().get(PACKAGE, ""), theirs.get(PACKAGE, "")
    if protocol == PROTOCOL and (not other or release(other) == release(ours)):
        return ""
    of = f" (eigenfail {other})" if other else ""
    return (
        f"The worker speaks protocol {protocol}{of}, the hub speaks {PROTOCOL} (eigenfail {ours}): "
        "install the same eigenfail on both."
    )


def foreign_reason(data: bytes) -> str:
    """Why a hello is refused that cannot be read as one of ours; empty if it is none at all."""
    hello = read_foreign_hello(data)
    return why_not(hello.protocol, hello.versions) if hello else ""


def release(version: str) -> tuple[str, ...]:
    """A version without its last number."""
    return (*version.split(".")[:2],)


def tell_difference(worker: str, theirs: Mapping[str, str]) -> None:
    """Say that a worker was let in that is of another correction."""
    ours, other = versions().get(PACKAGE, ""), theirs.get(PACKAGE, "")
    if other not in {"", ours}:
        log.warning("worker of another version", worker=worker, worker_has=other, hub_has=ours)
