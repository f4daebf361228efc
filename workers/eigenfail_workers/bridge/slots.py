"""The episodes in the slots of a bridge, in two groups that take turns.

While the bridge steps one group, this process measures the other. What an episode computes is its
own (`drive`): it does not depend on how many run beside it.
"""

from typing import NamedTuple

from eigenfail.errors import EpisodeError, InputError, SimulatorError
from eigenfail.values import EpisodeResult
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.drive import Drive
from eigenfail_workers.bridge.messages import Closed, Observations, Reset, Step

Group = dict[int, Drive]
"""By slot."""


class Asked(NamedTuple):
    """A request under way: of which group, and for which slots."""

    group: Group
    slots: tuple[int, ...]


class Slots:
    """Asks about a whole group in one message, and again when all of it is answered."""

    def __init__(self) -> None:
        self._groups: tuple[Group, Group] = {}, {}
        self._asked: dict[int, Asked] = {}

    def __len__(self) -> int:
        """How many episodes are under way."""
        return sum(map(len, self._groups))

    def free(self) -> int:
        """The lowest number that no episode has."""
        taken = self._groups[0].keys() | self._groups[1].keys()
        return next(slot for slot in range(len(taken) + 1) if slot not in taken)

    def put(self, slot: int, drive: Drive) -> None:
        """An episode that is to begin when its group is asked next."""
        min(self._groups, key=len)[slot] = drive

    def ask(self, connection: Connection) -> None:
        """Send what the groups have to say that wait for no answer.

        Raises:
            SimulatorError: the bridge takes no message.
        """
        waiting = [id(asked.group) for asked in self._asked.values()]
        for group in self._groups:
            if id(group) not in waiting:
                self._ask(connection, group)

    def _ask(self, connection: Connection, group: Group) -> None:
        session = connection.session
        new = tuple(slot for slot, drive in group.items() if not drive.has_begun)
        if new:
            starts = tuple([group[slot].start(slot) for slot in new])
            self._send(connection, Reset(session, connection.next_id(), starts), group, new)
        begun = tuple(slot for slot, drive in group.items() if drive.has_begun)
        if begun:
            pushes = tuple([group[slot].push(slot) for slot in begun])
            self._send(connection, Step(session, connection.next_id(), pushes), group, begun)

    def _send(
        self, connection: Connection, request: Reset | Step, group: Group, slots: tuple[int, ...]
    ) -> None:
        connection.send(request)
        self._asked[request.id] = Asked(group, slots)

    def hear(self, answer: Observations | Closed, connection: Connection) -> list[EpisodeResult]:
        """The results of those that are over, now that the connection has brought this answer.

        Raises:
            SimulatorError: nobody asked for this answer, or it is for more or fewer slots.
        """
        asked = self._asked.pop(answer.id, None)
        if asked is None or isinstance(answer, Closed):
            raise SimulatorError("The bridge answered another question.", "It repeats its `id`.")
        if len(answer.slots) != len(asked.slots):
            problem = f"The bridge answered for {len(answer.slots)} of {len(asked.slots)} slots."
            raise SimulatorError(problem, "It answers for each slot of the request, in its order.")
        beside, results = len(self), list[EpisodeResult]()
        for slot, seen in zip(asked.slots, answer.slots, strict=True):
            result = asked.group[slot].hear(seen, beside, connection)
            if result is not None:
                del asked.group[slot]
                results.append(result)
        return results

    def fail(self, error: EpisodeError | InputError) -> list[EpisodeResult]:
        """Give all episodes up; what is left of them."""
        beside = len(self)
        return [drive.fail(error, beside) for drive in self.clear()]

    def clear(self) -> list[Drive]:
        """Let go of all episodes; which they were."""
        drives = self.drives()
        self._asked.clear()
        for group in self._groups:
            group.clear()
        return drives

    def drives(self) -> list[Drive]:
        """The episodes under way."""
        return [drive for group in self._groups for drive in group.values()]
