"""Campaigns that no connected worker can run: what is said of them where people look."""

import time

import typer

from eigenfail.client import Client
from eigenfail.errors import EigenfailError
from eigenfail.values import Campaign, CampaignState

PATIENCE_S = 5.0
"""Of a campaign that gets on so often nothing is asked."""


def lacking(client: Client, campaign: Campaign) -> tuple[str, ...]:
    """Which worker a campaign waits for; nothing where one is there, or where it is not known."""
    if campaign.state != CampaignState.RUNNING:
        return ()
    try:
        stranded = client.staffing().stranded
    except EigenfailError:
        return ()
    return tuple(event.message for event in stranded if event.campaign == campaign.id)


class Lookout:
    """Says on standard error what a campaign lacks, once, if it does not get on.

    Args:
        client: of the service that runs it.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._done = -1
        self._next_s = 0.0
        self._said: tuple[str, ...] = ()

    def __call__(self, seen: Campaign) -> None:
        """Look, if nothing came for a while."""
        now_s, done = time.monotonic(), seen.counts.completed + seen.counts.failed
        if done == self._done and now_s < self._next_s:
            return
        if done == self._done:
            self._say(lacking(self._client, seen))
        self._done, self._next_s = done, now_s + PATIENCE_S

    def _say(self, words: tuple[str, ...]) -> None:
        if words and words != self._said:
            typer.echo("\n".join(words), err=True)
        self._said = words
