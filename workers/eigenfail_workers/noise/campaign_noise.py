"""The noise of a campaign: what each episode begins with, and the parameters that it chooses."""

from eigenfail.values.channels import PARAMETER, Channel, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeTask
from eigenfail.values.learning import Policy
from eigenfail_workers.noise import sources
from eigenfail_workers.noise.policy import store_policy


class CampaignNoise:
    """Begins the noise of the episodes of a campaign.

    Args:
        model: model of the disturbances, with its channels written out.

    Attributes:
        perceived: the channels that disturb a planner: all except channels of scenario parameters.
    """

    def __init__(self, model: DisturbanceModel) -> None:
        channels = model.list_channels()
        self.perceived: tuple[Channel, ...] = tuple(
            channel for channel in channels if channel.kind is not PARAMETER
        )
        self._count = len(channels)
        self._searched = {
            place: split_name(channel.name).quantity
            for place, channel in enumerate(channels)
            if channel.kind is PARAMETER
        }
        self._policies: dict[int, Policy] = {}

    @property
    def searched(self) -> tuple[str, ...]:
        """Names of the scenario parameters that the noise chooses."""
        return tuple(self._searched.values())

    def add_policy(self, policy: Policy) -> None:
        """Store a copy of a policy version; the oldest versions are dropped."""
        store_policy(self._policies, policy)

    def choose(self, task: EpisodeTask, longest: int) -> dict[str, float]:
        """Return z of each parameter that the noise of an episode chooses, by name.

        Args:
            task: the episode.
            longest: horizon of the longest episode. The horizon does not change the first step of
                the noise, nor any other step, because noise is drawn row by row.

        Raises:
            InvalidValue: the source cannot provide noise.
        """
        if not self._searched:
            return {}
        first = self.begin(task, longest).first()
        return {name: first[place] for place, name in self._searched.items()}

    def begin(self, task: EpisodeTask, horizon: int) -> sources.NoiseSource:
        """Return the noise of an episode.

        Raises:
            InvalidValue: the source cannot provide noise.
        """
        # Parameters are chosen before the first step, of which a policy has nothing to observe.
        context = sources.NoiseContext(
            task.seed, horizon, self._policies, self._count, tuple(self._searched)
        )
        return sources.begin(task.source, context)
