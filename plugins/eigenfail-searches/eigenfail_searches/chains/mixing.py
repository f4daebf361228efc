"""Whether Markov chains have forgotten their starts: R-hat and effective sample size.

Source: Vehtari, Gelman, Simpson, Carpenter and Bürkner 2021, Rank-normalization, folding, and
localization: an improved R-hat for assessing convergence of MCMC, Bayesian Analysis 16, 667–718.
Numbers of equations below are those of that paper.
"""

from math import inf, log10, nan

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST_DRAWS = 8
"""Of each chain; its halves are compared, and an autocorrelation of fewer than four says little."""


def compute_r_hat(draws: Array) -> float:
    """Return R-hat: the larger one of ranks and of folded ranks, from halves of chains.

    About 1 if all halves of all chains have the same distribution; infinite if no chain
    moves, but they differ; NaN if all draws are equal.

    Args:
        draws: values of one projection, shape (draws, chains), at least `FEWEST_DRAWS` draws.
    """
    halves = split_chains(draws)
    folded = np.abs(halves - np.median(halves))
    return max(_compare_variances(normalize_ranks(each)) for each in (halves, folded))


def compute_bulk_ess(draws: Array) -> float:
    """Return the bulk effective sample size: that of normalized ranks (section 4.3).

    The number of independent draws whose mean has the same error; NaN if all draws are equal.

    Args:
        draws: values of one projection, shape (draws, chains), at least `FEWEST_DRAWS` draws.
    """
    z = normalize_ranks(split_chains(draws))
    n, chains = z.shape
    within, variance = _estimate_variances(z)
    if variance == 0.0:
        return nan
    # Equation 10: autocorrelation over all chains, which counts what lies between them.
    correlation = 1.0 - (within - _autocovariance(z).mean(axis=1)) / variance
    correlation[0] = 1.0
    pairs = correlation[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    # Geyer's initial monotone sequence: sums of pairs are positive and fall in a reversible chain.
    negative = np.flatnonzero(pairs <= 0.0)
    kept = np.minimum.accumulate(pairs[: negative[0]] if negative.size else pairs)
    total = n * chains
    # Antithetic chains may be worth more than their draws; the paper's bound of that.
    return float(total / max(2.0 * float(kept.sum()) - 1.0, 1.0 / log10(total)))


def split_chains(draws: Array) -> Array:
    """Return the halves of chains as chains, shape (draws // 2, 2 · chains).

    Of an odd number of draws the one in the middle is left out.
    """
    half = len(draws) // 2
    return np.concatenate([draws[:half], draws[len(draws) - half :]], axis=1)


def normalize_ranks(draws: Array) -> Array:
    """Return the normal quantiles of the draws' ranks among all draws (equation 14)."""
    from scipy.special import ndtri  # imported late: the API starts sooner without it
    from scipy.stats import rankdata

    ranks = rankdata(draws, method="average", axis=None).reshape(draws.shape)
    quantiles: Array = ndtri((ranks - 0.375) / (draws.size + 0.25))
    return quantiles


def _estimate_variances(z: Array) -> tuple[float, float]:
    """Return the mean variance within chains, and that over all chains (equations 1 to 3)."""
    n, chains = z.shape
    within = float(z.var(axis=0, ddof=1).mean())
    between = float(z.mean(axis=0).var(ddof=1)) if chains > 1 else 0.0
    return within, (n - 1) / n * within + between


def _compare_variances(z: Array) -> float:
    """Return the square root of the variance over all chains ÷ that within chains (equation 4)."""
    within, variance = _estimate_variances(z)
    if within == 0.0:
        return inf if variance > 0.0 else nan
    return float(np.sqrt(variance / within))


def _autocovariance(z: Array) -> Array:
    """Return the autocovariance of each chain at each lag, shape (draws, chains)."""
    n = len(z)
    spectrum = np.fft.rfft(z - z.mean(axis=0), 2 * n, axis=0)
    products: Array = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n, axis=0)[:n]
    return products / n
