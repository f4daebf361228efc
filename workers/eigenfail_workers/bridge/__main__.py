"""Answer a question about bridges in a separate process: `python -m eigenfail_workers.bridge`.

The process reads an `eigenfail.bridges.BridgeQuestion` as JSON from standard input. It writes the
answer as JSON to standard output, as `eigenfail.processes` defines. The answer holds the results of
the checks, the bridge's offer, or the golden messages by name.
"""

from contextlib import closing
from pathlib import Path

import msgspec

from eigenfail import processes
from eigenfail.bridges import BridgeOffer, BridgeQuestion, GoldenMessages, OfferQuestion
from eigenfail.errors import EpisodeError
from eigenfail_workers.bridge.checks import check_bridge
from eigenfail_workers.bridge.connection import Connection

GOLDEN = Path(__file__).parent / "golden"
OFFER_S = 2.0
"""Time for a bridge to say what it offers; one that starts up is asked by its workers later."""


def answer_question(asked: bytes) -> bytes:
    """Return the answer to a question."""
    question: BridgeQuestion = msgspec.json.decode(asked, type=BridgeQuestion)
    # Needs no bridge: authors compare their messages with these before they have one.
    if isinstance(question, GoldenMessages):
        files = sorted(GOLDEN.glob("*.msgpack"))
        return msgspec.json.encode({file.stem: file.read_bytes() for file in files})
    if isinstance(question, OfferQuestion):
        return msgspec.json.encode(_ask_offer(question.address))
    return msgspec.json.encode(check_bridge(question.address, question.campaign))


def _ask_offer(address: str) -> BridgeOffer | None:
    """Return what a bridge offers; None if it does not answer, or violates the protocol."""
    try:
        with closing(Connection(address, left_s=OFFER_S)) as connection:
            return connection.welcome.offer
    except EpisodeError:
        return None


if __name__ == "__main__":
    processes.answer(answer_question)
