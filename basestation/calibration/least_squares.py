"""Nonlinear least squares by the method of Levenberg and Marquardt (Nocedal and Wright, 2006, chapter 10)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
S = TypeVar("S")

_STEPS = 30
_ENOUGH = 1e-10  # relative decrease of the cost that ends the search


class Fitted(NamedTuple, Generic[S]):
    """The result.

    Attributes:
        state: where the sum of squares is least.
        residuals: there, in standard deviations.
        information: (P, P), the inverse of the covariance of a step of the state.
    """

    state: S
    residuals: Array
    information: Array


def fit(
    state: S, evaluate: Callable[[S], tuple[Array, Array]], adjust: Callable[[S, Array], S], steps: int = _STEPS
) -> Fitted[S]:
    """Find the least sum of squares.

    Args:
        state: where to start.
        evaluate: the residuals (M,) of a state in standard deviations, and their derivatives (M, P) by a step.
        adjust: the state after a step (P,).
        steps: at most.
    """
    residuals, slopes = evaluate(state)
    cost, damping = float(residuals @ residuals), 1e-4
    for _ in range(steps):
        information, gradient = slopes.T @ slopes, slopes.T @ residuals
        scale = np.diag(information).copy()
        scale[scale <= 0.0] = 1.0
        before = cost
        while damping < 1e12:
            # Scaled by the diagonal: pixels and radians differ by orders of magnitude.
            root = np.sqrt(scale)
            matrix = information / np.outer(root, root) + damping * np.eye(len(scale))
            candidate = adjust(state, -np.linalg.solve(matrix, gradient / root) / root)
            new_residuals, new_slopes = evaluate(candidate)
            new_cost = float(new_residuals @ new_residuals)
            if new_cost <= cost:
                state, residuals, slopes, cost = candidate, new_residuals, new_slopes, new_cost
                damping = max(damping / 10.0, 1e-12)
                break
            damping *= 10.0
        else:
            break
        if before - cost <= _ENOUGH * max(before, 1e-12):
            break
    return Fitted(state, residuals, slopes.T @ slopes)
