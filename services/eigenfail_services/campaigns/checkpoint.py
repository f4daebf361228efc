"""The state of a campaign's rounds as bytes, without pickle."""

import msgspec

from eigenfail.errors import ProtocolError
from eigenfail.values import Policy, Round
from eigenfail.values.arrays import decode_array, encode_array
from eigenfail_services.campaigns.stopping import Tally

FORMAT = 2
"""Format 1 had neither tally nor stop rules; it is read as one of a campaign without rules."""


class Checkpoint(msgspec.Struct, frozen=True, eq=False, forbid_unknown_fields=True):
    """The learner's state and the rounds that were open when it was taken.

    Attributes:
        format: counts up when older programs could not read it.
        episodes: how many have been proposed.
        policy: the newest policy version.
        tally: of the rounds observed.
        stopped: the words of the stop rule that held; empty if none did.
    """

    format: int
    campaign_seed: int
    budget: int
    number: int
    episodes: int
    ended: bool
    policy: Policy | None
    rounds: tuple[Round, ...]
    learner: bytes
    tally: Tally = Tally()
    stopped: str = ""


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_decoder = msgspec.msgpack.Decoder(Checkpoint, dec_hook=decode_array)


def write_checkpoint(checkpoint: Checkpoint) -> bytes:
    """MessagePack, arrays in their binary form."""
    return _encoder.encode(checkpoint)


def read_checkpoint(data: bytes) -> Checkpoint:
    """What `Rounds.checkpoint` gave.

    Raises:
        ProtocolError: the bytes are no checkpoint, or one of a newer program.
    """
    try:
        checkpoint = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(
            f"The campaign's checkpoint cannot be read: {error}.", "Start the campaign anew."
        ) from error
    if not 1 <= checkpoint.format <= FORMAT:
        raise ProtocolError(
            f"The checkpoint has format {checkpoint.format}, this program reads {FORMAT}.",
            "Finish the campaign with the version of eigenfail that began it.",
        )
    return checkpoint
