"""The lock on a learner's port: other users of the machine reach it, and get nothing out of it.

CURVE answers nobody who does not know the hub's public key. This one is made for one life of one
learner, which finds it in its environment, where no other user can read it.
"""

import zmq

KEY_VARIABLE = "EIGENFAIL_LEARNER_KEY"


def lock(socket: "zmq.Socket[bytes]") -> str:
    """Have a socket, before it is bound, let in only who knows the key that comes back."""
    public, secret = zmq.curve_keypair()
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
    return public.decode()


def unlock(socket: "zmq.Socket[bytes]", key: str) -> None:
    """Have a socket, before it connects, speak with whoever made the key, and with nobody else."""
    public, secret = zmq.curve_keypair()
    socket.setsockopt(zmq.CURVE_SERVERKEY, key.encode())
    socket.setsockopt(zmq.CURVE_PUBLICKEY, public)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
