# SPDX-License-Identifier: MIT
"""Binomial intervals and one-sided bounds."""
from scipy.stats import beta, binom


def clopper_pearson(k, n, level=0.95):
    """Exact interval of a proportion; (0, 1) without data."""
    if n == 0:
        return 0.0, 1.0
    a = (1 - level) / 2
    lo = 0.0 if k == 0 else float(beta.ppf(a, k, n - k + 1))
    hi = 1.0 if k == n else float(beta.ppf(1 - a, k + 1, n - k))
    return lo, hi


def rate(k, n):
    lo, hi = clopper_pearson(k, n)
    return {"k": int(k), "n": int(n), "rate": k / n if n else None, "ci95": [lo, hi]}


def text(entry):
    if not entry["n"]:
        return "no case"
    return f"{entry['rate']:.3f} [{entry['ci95'][0]:.3f}, {entry['ci95'][1]:.3f}] ({entry['k']}/{entry['n']})"


def paired_p(lost, won):
    """Exact two-sided McNemar test: questions that only one of two programs has right fall to either side like a coin."""
    return min(1.0, 2 * float(binom.cdf(min(lost, won), lost + won, 0.5)))
