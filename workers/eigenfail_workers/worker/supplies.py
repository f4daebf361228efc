"""What the hub has sent ahead of its episodes: setups and policies."""

from eigenfail.values import EpisodeSetup, Policy, PolicySource
from eigenfail.wire.messages import PolicyUpdate, Setup
from eigenfail_workers.worker.child_process import ChildProcess, Held

KEPT_POLICIES = 8
"""More than a campaign can have open rounds at a time."""


class Supplies:
    """Kept for every campaign until it is dropped: each new child needs them again.

    Attributes:
        setups: by campaign.
    """

    def __init__(self) -> None:
        self.setups: dict[int, EpisodeSetup] = {}
        self._policies: dict[int, dict[int, Policy]] = {}

    def set_up(self, message: Setup) -> None:
        """Keep what a campaign's episodes share."""
        self.setups[message.campaign] = message.setup

    def learn(self, message: PolicyUpdate) -> None:
        """Keep a policy version; the oldest make room."""
        versions = self._policies.setdefault(message.campaign, {})
        versions[message.policy.version] = message.policy
        for old in sorted(versions)[:-KEPT_POLICIES]:
            del versions[old]

    def drop(self, campaign: int) -> None:
        """Forget what there is of a campaign."""
        self.setups.pop(campaign, None)
        self._policies.pop(campaign, None)

    def suffice(self, held: Held) -> bool:
        """Whether its campaign was not dropped meanwhile, and all that it needs is here."""
        source, policies = held.task.source, self._policies.get(held.campaign, {})
        prepared = not isinstance(source, PolicySource) or source.version in policies
        return held.wanted and held.campaign in self.setups and prepared

    def prepare(self, child: ChildProcess, held: Held) -> None:
        """Tell the child, once, what this episode needs: its campaign's setup, its policy."""
        child.set_up(held.campaign, self.setups[held.campaign])
        if isinstance(held.task.source, PolicySource):
            child.learn(held.campaign, self._policies[held.campaign][held.task.source.version])
