"""Answer a question about bridges in a separate process: `python -m eigenfail_workers.bridge`.

An `eigenfail.bridges.BridgeQuestion` is read as JSON from standard input, and the answer is written
as JSON to standard output, as `eigenfail.processes` defines: the results of the checks, or the
golden messages by name.
"""

from pathlib import Path

import msgspec

from eigenfail import processes
from eigenfail.bridges import BridgeQuestion, GoldenMessages
from eigenfail_workers.bridge.checks import check_bridge

GOLDEN = Path(__file__).parent / "golden"


def answer_question(asked: bytes) -> bytes:
    """Return the answer to a question."""
    question: BridgeQuestion = msgspec.json.decode(asked, type=BridgeQuestion)
    if isinstance(question, GoldenMessages):
        files = sorted(GOLDEN.glob("*.msgpack"))
        return msgspec.json.encode({file.stem: file.read_bytes() for file in files})
    return msgspec.json.encode(check_bridge(question.address, question.campaign))


if __name__ == "__main__":
    processes.answer(answer_question)
