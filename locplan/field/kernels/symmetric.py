"""Kernels of symmetric positive matrices, (n, d, d) with d up to 3: their logarithms and back.

numpy's eigh takes about five times as long for so small matrices.
"""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Floats

SWEEPS = 12
"""Maximum number of sweeps; three by three matrices take four to six."""
SMALLEST = float(np.finfo(float).tiny)
"""Eigenvalue whose logarithm stands for that of smaller ones."""


@njit(nogil=True, cache=True)
def diagonalize(matrix: Floats, vectors: Floats) -> None:
    """Diagonalize a symmetric matrix in place, and fill in its eigenvectors by column.

    This is Jacobi's method, whose small eigenvalues are as exact as the large ones.
    """
    d = len(matrix)
    for i in range(d):
        for j in range(d):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        is_diagonal = True
        for p in range(d - 1):
            for q in range(p + 1, d):
                apq = matrix[p, q]
                if abs(apq) <= 1e-17 * np.sqrt(abs(matrix[p, p] * matrix[q, q])):
                    continue
                is_diagonal = False
                ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * apq)
                tan = (1.0 if ratio >= 0 else -1.0) / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                cos = 1.0 / np.sqrt(tan * tan + 1.0)
                sin = tan * cos
                for k in range(d):
                    if k not in (p, q):
                        akp, akq = matrix[k, p], matrix[k, q]
                        matrix[k, p] = matrix[p, k] = cos * akp - sin * akq
                        matrix[k, q] = matrix[q, k] = sin * akp + cos * akq
                    vkp, vkq = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = cos * vkp - sin * vkq, sin * vkp + cos * vkq
                matrix[p, p] -= tan * apq
                matrix[q, q] += tan * apq
                matrix[p, q] = matrix[q, p] = 0.0
        if is_diagonal:
            return


@njit(nogil=True, cache=True)
def compute_log_or_exp(matrices: Floats, is_log: bool) -> Floats:
    """Return logarithms or exponentials of symmetric matrices, (n, d, d); NaN stays.

    Logarithms are taken of eigenvalues of at least the smallest normal number.
    """
    n, d, _ = matrices.shape
    result = np.empty((n, d, d))
    matrix, vectors, values = np.empty((d, d)), np.empty((d, d)), np.empty(d)
    for m in range(n):
        for i in range(d):
            for j in range(d):
                matrix[i, j] = matrices[m, i, j]
        diagonalize(matrix, vectors)
        for k in range(d):
            value = matrix[k, k]
            if is_log:
                values[k] = (
                    value if np.isnan(value) else np.log(max(value, 2.2250738585072014e-308))
                )
            else:
                values[k] = np.exp(value)
        for i in range(d):
            for j in range(i, d):
                total = 0.0
                for k in range(d):
                    total += vectors[i, k] * values[k] * vectors[j, k]
                result[m, i, j] = result[m, j, i] = total
    return result
