"""Checkpoints in memory."""

from msgspec.structs import replace

from eigenfail.values import Estimate
from eigenfail.values.records import Job
from eigenfail_services.store import sentences
from eigenfail_services.store.checkpoints import digest, is_whole, tell_damaged
from eigenfail_services.store.limits import KEPT_CHECKPOINTS
from eigenfail_services.store.memory.tables import KeptCheckpoint, Tables
from eigenfail_services.store.refusals import damaged_checkpoint


class MemoryCheckpoints:
    """The last two checkpoints of each campaign, oldest first, each with the hash of all of it."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def save(
        self,
        campaign: int,
        checkpoint: bytes,
        estimate: Estimate | None = None,
        trained_episodes: int | None = None,
        claim: Job | None = None,
    ) -> None:
        """A new checkpoint, and what the campaign's learner told, all or nothing."""
        with self._tables.lock:
            before = self._tables.campaign(campaign)
            self._tables.fence(claim)
            self._tables.campaigns[campaign] = replace(
                before, estimate=estimate, trained_episodes=trained_episodes
            )
            kept = self._tables.checkpoints.setdefault(campaign, [])
            kept.append(KeptCheckpoint(checkpoint, digest(checkpoint)))
            del kept[:-KEPT_CHECKPOINTS]

    def load(self, campaign: int) -> bytes | None:
        """The newest checkpoint that is whole, if there is one."""
        with self._tables.lock:
            kept = self._tables.checkpoints.get(campaign, [])
            return kept[self._newest_whole(campaign)].state if kept else None

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """The same, to go on from: newer ones that are damaged are dropped, with an event."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            self._tables.fence(claim)
            kept = self._tables.checkpoints.get(campaign, [])
            if kept and (whole := self._newest_whole(campaign)) < len(kept) - 1:
                del kept[whole + 1 :]
                tell_damaged(campaign)
                sentence = sentences.checkpoint_damaged(campaign)
                self._tables.log("checkpoint.damaged", sentence, campaign)
            return kept[-1].state if kept else None

    def _newest_whole(self, campaign: int) -> int:
        kept = self._tables.checkpoints[campaign]
        whole = [place for place, each in enumerate(kept) if is_whole(each.state, each.sha256)]
        if not whole:
            raise damaged_checkpoint(campaign)
        return whole[-1]
