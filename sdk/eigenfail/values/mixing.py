"""Whether the Markov chains of a campaign have forgotten the failures they started from."""

import msgspec

LARGEST_R_HAT = 99.0
"""Stated of chains that differ and do not move at all."""


class ProjectionMixing(msgspec.Struct, frozen=True):
    """How well chains mix, by one number that each of their failures has.

    Attributes:
        name: what the number is.
        r_hat: rank-normalized split R-hat; 1 where all chains have the same distribution, at most
            `LARGEST_R_HAT`.
        effective: bulk effective sample size: number of independent samples whose mean is known as
            precisely.
    """

    name: str
    r_hat: float
    effective: float


class ChainMixing(msgspec.Struct, frozen=True, kw_only=True):
    """How far the chains of a campaign of `chains` have mixed, after its last whole round.

    Attributes:
        campaign: id of the campaign.
        chains: number of chains.
        started: number of chains whose start failed; the others began where these did.
        moves: number of moves after burn-in that were completed, of all chains.
        accepted: number of them that failed, which is that of the accepted samples.
        first_sample: index of the first episode after burn-in.
        draws: number of states of each chain that the projections are of.
        projections: by projection, those of the largest R-hat first; empty before there are enough
            draws.
        mixed: whether all of them are within the bounds of `verdict`.
        verdict: whether the chains have mixed, with the reason, in words.
        remark: what the samples cannot show, in words.
    """

    campaign: int
    chains: int
    started: int
    moves: int
    accepted: int
    first_sample: int
    draws: int
    projections: tuple[ProjectionMixing, ...]
    mixed: bool
    verdict: str
    remark: str
