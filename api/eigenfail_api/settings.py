"""How the API is set up."""

from ipaddress import ip_address
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from eigenfail.errors import InvalidValue

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


class ApiSettings(BaseSettings):
    """From arguments or, for what is not given, from environment variables EIGENFAIL_<NAME>.

    Attributes:
        database: URL of the store.
        host: address to listen on.
        port: to listen on; 0 takes a free one.
        trust_network: listen for other machines although nobody has to show a key. For containers
            behind a private network, and nothing else.
        hosts: names under which this machine may be asked, against DNS rebinding.
        max_body_bytes: largest body of a request.
        poll_s: how often the event log is looked at while somebody follows it.
    """

    model_config = SettingsConfigDict(env_prefix="EIGENFAIL_", frozen=True, extra="forbid")

    database: str = "sqlite:///eigenfail-data/eigenfail.db"
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8440
    trust_network: bool = False
    hosts: tuple[str, ...] = LOOPBACK_NAMES
    max_body_bytes: Annotated[int, Field(ge=1)] = 1_000_000
    poll_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.25

    @property
    def is_private(self) -> bool:
        """Whether only this machine can reach the address."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def refuse_open_door(settings: ApiSettings) -> None:
    """An address that strangers can reach.

    Raises:
        InvalidValue: it is one, and nobody vouched for the network.
    """
    if not (settings.is_private or settings.trust_network):
        raise InvalidValue(
            "host",
            f"'{settings.host}' can be reached from other machines, and keys are not available "
            "yet.",
            "Listen on 127.0.0.1, or set EIGENFAIL_TRUST_NETWORK=1 where the network is private.",
        )
