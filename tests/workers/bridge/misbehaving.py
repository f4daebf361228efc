"""A bridge whose scenarios go wrong, each as its name says: `python misbehaving.py ADDRESS`."""

import os
import sys
import time
from pathlib import Path
from typing import Any

import zmq
from msgspec.msgpack import decode, encode

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "bridge"))

import minimal

AFTER_STEPS = 5


def hang(_answer: dict[str, Any]) -> bytes:
    time.sleep(3600.0)
    return b""


def die(_answer: dict[str, Any]) -> bytes:
    os._exit(1)


def spoil(key: str, value: object):
    def spoilt(answer: dict[str, Any]) -> bytes:
        return encode({**answer, key: value})

    return spoilt


def show_nan(answer: dict[str, Any]) -> bytes:
    answer["slots"][0]["ego"] = [float("nan")] * 6
    return encode(answer)


def jump(answer: dict[str, Any]) -> bytes:
    answer["slots"][0]["step"] += 1
    return encode(answer)


def blame(kind: str):
    def fail(answer: dict[str, Any]) -> bytes:
        return encode({"type": "error", "id": answer["id"], "fault": kind, "message": "No more."})

    return fail


WAYS = {
    "hangs": hang,
    "dies": die,
    "garbage": lambda _: os.urandom(64),
    "empty": lambda _: b"",
    "nan": show_nan,
    "jumps": jump,
    "another id": spoil("id", 10**6),
    "too few": spoil("slots", []),
    "welcomes": lambda _: encode(minimal.welcome()),
    "closes": spoil("type", "closed"),
    "planner": blame("planner"),
    "solver": blame("solver"),
    "input": blame("input"),
}


def in_cut_in(asked: dict[str, Any]):
    return minimal.built_in({**asked, "scenario": "cut_in"})


def main(address: str) -> None:
    """Answer as one should, but for one step of each episode in slot 0."""
    welcome = minimal.welcome(4)
    cut_in = welcome["scenarios"][0]
    welcome["scenarios"] += [{**cut_in, "name": how} for how in WAYS]
    bridge, steps, how = minimal.Bridge(welcome, in_cut_in), 0, "cut_in"
    server = zmq.Context.instance().socket(zmq.REP)
    server.bind(address)
    while True:
        request = decode(server.recv())
        if request["type"] == "reset":
            steps, how = 0, request["slots"][0]["scenario"]
        steps += request["type"] == "step"
        answer = bridge.answer(request)
        wrong = how in WAYS and request["type"] == "step" and steps == AFTER_STEPS + 1
        server.send(WAYS[how](answer) if wrong else encode(answer))


if __name__ == "__main__":
    main(*sys.argv[1:])
