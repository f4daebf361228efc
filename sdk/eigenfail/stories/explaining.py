"""The explanation of a stored episode, made in a process of its own."""

import msgspec

from eigenfail import side_process
from eigenfail.stories.explanations import WHOLE, explanation_of
from eigenfail.stories.replays import explain_episode
from eigenfail.values import CampaignSpec, EpisodeResult, Explanation
from eigenfail.values.arrays import decode_array, encode_array

MODULE = "eigenfail.stories"
PATIENCE_S = 60.0


class Wanted(msgspec.Struct, frozen=True, eq=False):
    """Which episode is to be explained."""

    campaign: int
    spec: CampaignSpec
    stored: EpisodeResult


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_questions = msgspec.msgpack.Decoder(Wanted, dec_hook=decode_array)
_answers = msgspec.msgpack.Decoder(Explanation, dec_hook=decode_array)


def question(campaign: int, spec: CampaignSpec, stored: EpisodeResult) -> bytes:
    """What a process is asked; the same for the same episode."""
    return _encoder.encode(Wanted(campaign, spec, stored))


def explain_aside(asked: bytes, patience_s: float = PATIENCE_S) -> Explanation:
    """The explanation that a process of its own makes, whatever becomes of it.

    Args:
        asked: made by `question`.
        patience_s: after so long it is given up. [s]

    Raises:
        InvalidValue: the episode has no course to explain.
        ServiceError: the world is not installed here, or there was no answer.
    """
    return _answers.decode(side_process.ask(MODULE, asked, patience_s))


def reply(asked: bytes) -> bytes:
    """The answer to a question, in the process that was started for it."""
    return _encoder.encode(explained(_questions.decode(asked)))


def explained(wanted: Wanted) -> Explanation:
    """With the scene, if only the replay has one and it is the stored episode's."""
    stored = wanted.stored
    replayed, episode = explain_episode(wanted.spec, stored)
    name = f"{wanted.campaign}/{stored.index}"
    told = explanation_of(name, wanted.spec.planner, replayed, episode, WHOLE)
    has_news = replayed.same and stored.scene is None
    return msgspec.structs.replace(told, scene=episode.result.scene if has_news else None)
