"""Monomials of several variables: the basis of polynomial regression."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.observation import Array

Exponents = NDArray[np.int64]
"""Of monomials (k) in variables (v): (k, v)."""


def exponents(degrees: Sequence[int], variables: Sequence[int], most: int) -> Exponents:
    """Of all monomials whose degree is bounded in each group of variables, and in all of them together.

    Args:
        degrees: The highest degree in each group.
        variables: How many variables each group has.
        most: The highest degree in all variables together.
    """
    groups = [_of_degree(min(degree, most), count) for degree, count in zip(degrees, variables, strict=True)]
    all_of_them = ([power for part in parts for power in part] for parts in product(*groups))
    return np.array([each for each in all_of_them if sum(each) <= most])


def _of_degree(degree: int, variables: int) -> list[tuple[int, ...]]:
    if not variables:
        return [()]
    return [
        (power, *rest) for power in range(degree + 1) for rest in _of_degree(degree - power, variables - 1)
    ]


def monomials(values: Array, powers: Exponents) -> Any:
    """Monomials (n, k) of values (n, v), by their exponents (k, v)."""
    table = values[:, None, :] ** np.arange(powers.max(initial=0) + 1)[:, None]
    result = np.ones((len(values), len(powers)))
    for variable, power in enumerate(powers.T):
        result *= table[:, power, variable]
    return result
