"""Points that fill a cube evenly: Sobol's sequence, scrambled."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array

_BITS = 30
_NUMBERS = """
3 1; 7 1 3; 11 1 3 1; 13 1 1 1; 19 1 1 3 3; 25 1 3 5 13; 37 1 1 5 5 17; 41 1 1 5 5 5; 47 1 1 7 11
19; 55 1 1 5 1 1; 59 1 1 1 3 11; 61 1 3 5 5 31; 67 1 3 3 9 7 49; 91 1 1 1 15 21 21; 97 1 3 1 13 27
49; 103 1 1 1 15 7 5; 109 1 3 1 15 13 25; 115 1 1 5 5 19 61; 131 1 3 7 11 23 15 103; 137 1 3 7 13
13 15 69; 143 1 1 3 13 7 35 63; 145 1 3 5 9 1 25 53; 157 1 3 1 13 9 35 107; 167 1 3 1 5 27 61 31;
171 1 1 5 11 19 41 61; 185 1 3 5 3 3 13 69; 191 1 1 7 13 1 19 1; 193 1 3 7 5 13 19 59; 203 1 1 3 9
25 29 41; 211 1 3 5 13 23 1 55; 213 1 3 7 3 13 59 17; 229 1 3 1 3 5 53 69; 239 1 1 5 5 23 33 13;
241 1 1 7 7 1 61 123; 247 1 1 7 9 13 61 49; 253 1 3 3 5 3 55 33; 285 1 3 1 15 31 13 49 245; 299 1
3 5 15 31 59 63 97; 301 1 3 1 11 11 11 77 249; 333 1 3 1 11 27 43 71 9; 351 1 1 7 15 21 11 81 45;
355 1 3 7 3 25 31 65 79; 357 1 3 1 1 19 11 3 205; 361 1 1 5 9 19 21 29 157; 369 1 3 7 11 1 33 89
185; 391 1 3 3 3 15 9 79 71; 397 1 3 7 11 15 39 119 27
"""
# Of each dimension but the first a primitive polynomial, as bits, and its first direction numbers:
# S. Joe and F. Y. Kuo, SIAM J. Sci. Comput. 30(5), 2008, their file new-joe-kuo-6.21201.
_FIRST = [[1], *([int(n) for n in own.split()] for own in _NUMBERS.split(";"))]


class Sobol:
    """The points of ``scipy.stats.qmc.Sobol``, whose module alone takes half a second to import.

    Scrambled by a linear matrix and a digital shift (J. Matousek, J. Complexity 14(4), 1998). What is
    beyond 48 dimensions is drawn by chance.

    d : int, dimensions; rng : numpy.random.Generator
    """

    def __init__(self, d: int, rng: np.random.Generator) -> None:
        rng, self._beyond = rng.spawn(1)[0], max(0, d - len(_FIRST))
        self._rng, self._drawn = rng, 0
        d -= self._beyond
        bits = np.arange(_BITS)
        self._shift = rng.integers(2, size=(d, _BITS), dtype=np.uint32) @ (1 << bits).astype(
            np.uint32
        )
        L = np.tril(rng.integers(2, size=(d, _BITS, _BITS), dtype=np.uint32))
        L[:, bits, bits] = 1
        V = np.array([_directions(*_FIRST[k]) for k in range(d)], dtype=np.int64).reshape(d, _BITS)
        digits = (V[:, None, :] >> bits[::-1, None]) & 1  # the most significant first
        self._V = (
            ((L.astype(np.int64) @ digits) % 2 << bits[::-1, None]).sum(axis=1).astype(np.uint32)
        )

    def random(self, count: int) -> Array:
        """The next so many points, shape (count, d), in [0, 1)."""
        index = np.arange(self._drawn, self._drawn + count, dtype=np.uint32)
        self._drawn += count
        gray = (index ^ (index >> 1))[:, None]
        found = np.broadcast_to(self._shift, (count, len(self._shift))).copy()
        for k in range(self._drawn.bit_length()):
            found ^= (gray >> k & 1) * self._V[:, k]
        return np.concatenate([found / 2.0**_BITS, self._rng.random((count, self._beyond))], axis=1)


def _directions(polynomial: int, *first: int) -> list[int]:
    """Direction numbers by the recurrence of the polynomial, as digits after the point."""
    m, degree = list(first), polynomial.bit_length() - 1
    for j in range(degree, _BITS):
        new = m[j - degree] if degree else 1
        for k in range(1, degree + 1):
            new ^= (polynomial >> (degree - k) & 1) * (m[j - k] << k)
        m.append(new)
    return [value << (_BITS - 1 - j) for j, value in enumerate(m)]
