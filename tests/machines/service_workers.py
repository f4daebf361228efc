"""The workers of a played service: what a true one does, when the test says so."""

from eigenfail.values.episode import PolicySource
from eigenfail.wire import messages

CREDIT = 4

Key = tuple[int, int]


class FakeWorker:
    """One process: does what it is told, when it is told to; keeps results until the ack."""

    def __init__(self, connection: bytes, name: str) -> None:
        self.connection, self.name = connection, name
        self.life, self.asked = connection.decode(), 0
        self.heard = True
        self.welcome = self.missed = False
        self.words: list[object] = []
        self.held: dict[Key, object] = {}
        self.outbox: dict[Key, object] = {}
        self.setups: dict[int, object] = {}
        self.policies: set[Key] = set()
        self.heeding = {
            messages.Welcome: self.welcomed,
            messages.Refusal: self.refused,
            messages.Setup: self.set_up,
            messages.PolicyUpdate: lambda m: self.policies.add((m.campaign, m.policy.version)),
            messages.Lease: self.lease,
            messages.Ack: self.ack,
            messages.Drop: self.drop,
            messages.Goodbye: self.refused,
        }

    def welcomed(self, _message) -> None:
        self.asked += not self.welcome
        self.welcome, self.missed = True, False
        self.bring_again()

    def set_up(self, message) -> None:
        self.setups[message.campaign] = message.setup

    def bring_again(self) -> None:
        for (campaign, _), done in self.outbox.items():
            self.words.append(messages.Results(campaign, (done,)))

    def refused(self, _message) -> None:
        self.welcome = False

    def lease(self, message) -> None:
        for task in message.tasks:
            if not self.can_run(message.campaign, task.source):
                assert self.missed, "what it needs was not sent before it"
                self.welcome = False
            elif (message.campaign, task.index) in self.outbox:
                self.bring_again()
            else:
                self.held[message.campaign, task.index] = task

    def can_run(self, campaign: int, source) -> bool:
        by_policy = isinstance(source, PolicySource)
        known = not by_policy or (campaign, source.version) in self.policies
        return campaign in self.setups and known

    def ack(self, message) -> None:
        for index in message.indices:
            self.outbox.pop((message.campaign, index), None)

    def drop(self, message) -> None:
        self.setups.pop(message.campaign, None)
        self.policies = {key for key in self.policies if key[0] != message.campaign}
        self.held = {key: task for key, task in self.held.items() if key[0] != message.campaign}

    def beat(self) -> object:
        if not self.welcome:
            return self.hello()
        return messages.Heartbeat(*next(iter(self.held), (None, None)), tuple(self.held))

    def hello(self) -> messages.Hello:
        """With all that it holds, finished or not."""
        held = (
            messages.Holding(
                campaign, index, messages.fingerprint_task(self.setups[campaign], task)
            )
            for (campaign, index), task in self.held.items()
        )
        holdings = (*held, *(messages.Holding(*key) for key in self.outbox))
        return messages.Hello(
            messages.PROTOCOL,
            self.name,
            CREDIT,
            life=self.life,
            asked=self.asked,
            holdings=holdings,
        )
