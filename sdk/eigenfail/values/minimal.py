"""What is left of a failure once all the noise that it does not need is gone."""

import msgspec


class MinimalFailure(msgspec.Struct, frozen=True, kw_only=True):
    """A failure, as far as a campaign of `minimal` has shrunk it.

    Attributes:
        campaign: the one that shrank it; with `index` the episode whose noise is told.
        done: whether the search came to its end: no step of one axis can be left out, and the whole
            cannot be weaker, without losing the failure.
        because: why the search is where it is, in words.
        words: what the noise does, in words.
        needed: pairs of a step and an axis that still hold noise; at first `injected` did.
        energy: sum of z² over them; `full_energy` at first. [sigma²]
        log_probability: of the shrunk failure, summed over its steps; of the failure at full
            strength: `full_log_probability`.
        log_probability_per_step: of the shrunk failure; `full_log_probability_per_step` likewise.
    """

    campaign: int
    index: int
    done: bool
    because: str
    words: str
    needed: int
    injected: int
    energy: float
    full_energy: float
    log_probability: float
    full_log_probability: float
    log_probability_per_step: float
    full_log_probability_per_step: float
