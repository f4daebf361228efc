"""How many kinds of failure a campaign found, and whether it keeps finding the same one."""

import msgspec

COLLAPSED_SHARE = 0.9
"""A larger share of the failures in one mode is called mode collapse."""

NARROW_SPREAD = 0.5
"""Failures of one mode that differ less than this are called mode collapse, too. [sigma]"""


class Diversity(msgspec.Struct, frozen=True, kw_only=True):
    """How the failures of a campaign spread over modes.

    Where clusters cannot be told from those of noise, all failures count as one mode.

    Attributes:
        failures: how many it rests on.
        modes: clusters that are more than what clustering finds in noise; at least 1.
        largest_share: of the failures, in the largest mode.
        effective_modes: exp of the Shannon entropy of the shares (Hill 1973): 1 where all are in
            one mode, `modes` where all modes hold equally many.
        spread: how much the failures differ: root mean square over steps and axes of the standard
            deviation of z between failures; 1 for noise of p(x), None of a single failure. [sigma]
        coverage: how many of the modes had been seen after each tenth of the campaign's episodes.
        verdict: what all of it says.
        warning: that the modes have collapsed, and what to try; empty otherwise.
    """

    failures: int
    modes: int
    largest_share: float
    effective_modes: float
    spread: float | None
    coverage: tuple[int, ...]
    verdict: str
    warning: str = ""
