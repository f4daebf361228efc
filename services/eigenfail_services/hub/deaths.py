"""Episodes that were running as their workers were lost: counted for good, and at last given up."""

from eigenfail.contracts import EpisodeStore
from eigenfail.errors import NotFound
from eigenfail.values import EpisodeFault, EpisodeTask, unrunnable
from eigenfail_services.hub.commits import Commits
from eigenfail_services.hub.leases import Leases

HUB = b"hub"
MAX_DEATHS = 3


class Deaths:
    """Asks the store, which outlives this hub, how many workers an episode has taken with it."""

    def __init__(self, leases: Leases, commits: Commits, episodes: EpisodeStore) -> None:
        self._leases = leases
        self._commits = commits
        self._episodes = episodes

    def count(self) -> None:
        """Write down what happened since the last call; whom nobody gets until then waits again.

        Raises:
            StoreUnavailable: it could not be written, and is tried again at the next call.
        """
        for campaign, task in self._leases.suspects():
            if self._died(campaign, task) < MAX_DEATHS:
                self._leases.acquit(campaign, task.index)
            else:
                self._give_up(campaign, task)

    def _died(self, campaign: int, task: EpisodeTask) -> int:
        try:
            return self._episodes.add_death(campaign, task.index)
        except NotFound:  # its campaign was removed: nobody will miss it
            return MAX_DEATHS

    def _give_up(self, campaign: int, task: EpisodeTask) -> None:
        words = f"{MAX_DEATHS} workers were lost while they ran it."
        result = unrunnable(task, EpisodeFault("infrastructure", words))
        self._leases.bring(campaign, task.index, result.wall_s, HUB)
        self._commits.add(HUB, HUB.decode(), campaign, result)
