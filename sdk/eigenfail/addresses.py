"""Addresses: database URLs, and which hosts are this machine."""

import os
import re
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import quote, unquote_to_bytes

from eigenfail.errors import InvalidValue

ENDPOINT = re.compile(r"tcp://(?P<host>\[[^\[\]]+\]|[^\[\]:;/@]+):[^:;/@]+")
"""Of ZeroMQ, as one listens on it or connects to it."""


PIPE = "ipc://"


TRUST_VARIABLE = "EIGENFAIL_TRUST_NETWORK"
"""Environment variable; "1" declares the network beyond this machine as trusted."""


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine: a loopback address or `localhost`.

    Other names are not looked up: they may name another machine by the time they are used.

    Args:
        host: host without a port; an IPv6 address with or without brackets.
    """
    # URLs write IPv6 in brackets, the `ipaddress` module reads it without.
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        return ip_address(bare).is_loopback
    except ValueError:
        # Names of hosts have no case. `localhost` is fixed to loopback by RFC 6761, no other name
        # is.
        return bare.lower() == "localhost"


def is_own_endpoint(address: str) -> bool:
    """Return whether a ZeroMQ address is on this machine; False if it cannot be parsed."""
    found = ENDPOINT.fullmatch(address)
    return address.startswith(PIPE) or (found is not None and is_loopback(found["host"]))


FORM = "Write sqlite:///folder/file.db; memory:// keeps everything in this process."


_SQLITE = re.compile(r"sqlite(\+pysqlite)?://(?P<host>[^/]*)(/(?P<path>.*))?", re.DOTALL)


def sqlite_url(path: Path) -> str:
    """Return the URL of the SQLite database in a file."""
    # As bytes: names of files need not be valid UTF-8, and the way back must give the same file.
    return f"sqlite:///{quote(os.fsencode(path))}"


def sqlite_path(url: str) -> Path:
    """Return the absolute path of the file that a SQLite URL names.

    Raises:
        InvalidValue: it is not a SQLite URL, names no file, or has a part after a `?`.
    """
    found = _SQLITE.fullmatch(url)
    if found is None or found["host"]:
        raise InvalidValue("database", "The address cannot be read.", FORM)
    text = found["path"] or ""
    if "?" in text:
        # Dropping what stands behind it would open another file than the one that was meant.
        raise InvalidValue(
            "database",
            "The address of a SQLite database has a '?'.",
            "Write %3F where it belongs to the path, and leave it out otherwise: there are no "
            "options.",
        )
    name = unquote_to_bytes(text)
    # SQLite would open a database in memory for the first two, which other processes cannot see.
    if name in {b"", b":memory:"} or b"\0" in name:
        raise InvalidValue("database", "The address does not contain a file name.", FORM)
    return Path(os.fsdecode(name)).absolute()


def sqlite_uri(path: Path, mode: str) -> str:
    """Return the `file:` URI that SQLite itself opens.

    Args:
        path: path of the file.
        mode: SQLite's mode ro, rw or rwc; only rwc creates a missing file.
    """
    return f"file:{quote(os.fsencode(path.absolute()))}?mode={mode}"
