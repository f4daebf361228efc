"""Episodes, as a client sees them."""

from collections.abc import Iterator

import msgspec

from eigenfail.client.link import Link
from eigenfail.values import Outcome, Page
from eigenfail.values.arrays import Floats
from eigenfail.values.records import EpisodeDetail, EpisodeOrder, EpisodeRow


class Episodes:
    """Read what came of episodes.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def list(
        self,
        campaign: int,
        outcome: Outcome | str | None = None,
        sort: EpisodeOrder | str = EpisodeOrder.INDEX,
    ) -> Iterator[EpisodeRow]:
        """The finished episodes of a campaign, or those of one outcome; in index order.

        Sorted by `severity`, the worst collision comes first.

        Raises:
            NotFound: no such campaign.
        """
        path = f"/campaigns/{campaign}/episodes"
        return self._link.pages(path, Page[EpisodeRow], "after", {"outcome": outcome, "sort": sort})

    def get(self, campaign: int, index: int) -> EpisodeDetail:
        """One result with its class, its noise and, where it was kept, its scene.

        Raises:
            NotFound: no such campaign, or the episode has no result yet.
        """
        result = self._link.get(f"/campaigns/{campaign}/episodes/{index}", EpisodeDetail)
        z, sigma = pairs(result.noise.z), pairs(result.noise.sigma)
        noise = msgspec.structs.replace(result.noise, z=z, sigma=sigma)
        return msgspec.structs.replace(result, noise=noise)


def pairs(array: Floats) -> Floats:
    """The array in its shape (steps, 2), which JSON forgets where there is no step."""
    return array.reshape(-1, 2)
