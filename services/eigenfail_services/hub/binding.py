"""Where the hub listens, and what it takes to listen there."""

import os
from pathlib import Path

import zmq

from eigenfail.errors import InvalidValue, PortTaken
from eigenfail.loopback import TRUST_VARIABLE, is_own_endpoint
from eigenfail.wire.messages import MAX_MESSAGE_BYTES
from eigenfail_services.hub.door import Door
from eigenfail_services.hub.keys import FIELD, HubKeys, KeyFolder, closed_to_us

KEYS_VARIABLE = "EIGENFAIL_HUB_KEYS"


def keys_for(address: str, folder: Path | None) -> HubKeys | None:
    """The keys with which to listen at an address; None if it is to be done without.

    Raises:
        InvalidValue: the folder holds no keys; or there is none, and other machines reach the
            address over a network for which nobody vouches.
    """
    if folder is not None:
        return keys_in(folder)
    if not is_own_endpoint(address) and os.environ.get(TRUST_VARIABLE) != "1":
        raise InvalidValue(
            "hub",
            f"'{address}' can be reached from other machines, and there are no keys for workers.",
            f"Make keys with `eigenfail worker key create` and name their folder with {FIELD}; "
            f"or listen on tcp://127.0.0.1:PORT. On a private network, {TRUST_VARIABLE}=1 does "
            "without keys and encryption.",
        )
    return None


def keys_in(folder: Path) -> HubKeys:
    """The keys in a folder.

    Raises:
        InvalidValue: there are none, or it cannot be read.
    """
    try:
        return HubKeys(KeyFolder(folder))
    except OSError as error:
        raise closed_to_us(folder, error) from error


def bind(address: str, keys: HubKeys | None = None) -> "zmq.Socket[bytes]":
    """A ROUTER at the address; with keys, only who is let in reaches it, over CURVE.

    Raises:
        PortTaken: it cannot be bound.
    """
    router: zmq.Socket[bytes]
    router = Door(keys).router() if keys else zmq.Context.instance().socket(zmq.ROUTER)
    router.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
    router.setsockopt(zmq.LINGER, 1_000)
    router.setsockopt(zmq.ROUTER_MANDATORY, 1)  # what is for nobody is not dropped without a word
    try:
        router.bind(address)
    except zmq.ZMQError as error:
        router.close()
        raise PortTaken(f"{address} cannot be bound: {error}.", "Choose another port.") from error
    return router
