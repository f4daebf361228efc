"""The workers that Ray is to have, by name."""

import os
import platform
from collections.abc import Iterator
from itertools import count

from eigenfail.hosting.span import Span
from eigenfail_services.campaigns.launching.scaling import Scale, needed, to_let_go
from eigenfail_services.hub.muster import Muster


def new_names() -> Iterator[str]:
    """Names that no other service gives, on this machine or another one."""
    return (f"{platform.node()}-{os.getpid()}.{number}" for number in count())


class Roll:
    """Takes names on as more workers are needed, and strikes out those of whom nothing is needed.

    Attributes:
        names: in the order in which they were taken on.
    """

    def __init__(self, span: Span) -> None:
        self._scale = Scale(span)
        self._new = new_names()
        self.names: list[str] = []
        self._fill(span.least)

    def look(self, now_s: float, muster: Muster) -> None:
        """Bring it to the number that the work asks for, as far as nobody is called off it."""
        others = len(muster.present.difference(self.names))
        wanted = self._scale.look(now_s, needed(muster.work) - others)
        surplus = max(0, len(self.names) - wanted)
        gone = to_let_go(self.names, muster.present, muster.idle, surplus)
        self.names = [name for name in self.names if name not in gone]
        self._fill(wanted)

    def _fill(self, n: int) -> None:
        self.names += (next(self._new) for _ in range(n - len(self.names)))
