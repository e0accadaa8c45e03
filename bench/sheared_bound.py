#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the best sheared filter of shadow samples could gain over the best axis-aligned one: docs/axis_aligned.md, "Successors".

Flatland, receivers of pixel width 1/32 under a uniform light of half width sqrt(3) (standard deviation 1). Open and blocked of a layer of slope s is a
stationary process of x + s y with an exponential correlation of length 0.3 (1 + s), as edges have. Of all linear estimates of V from the samples within
+-24 pixels, each in one of 8 parts of the light and with independent noise, the one of least expected square error (Gauss, Markov) may weigh pixel and part
as it likes: any sheared filter is one of these. An axis-aligned filter is one that weighs all parts of a pixel's light alike. Layers one behind the other
multiply: beside either's own process there is the product of both, whose spectrum is not in the wedge between the slopes.

  bench/sheared_bound.py        a table; wants numpy
"""
import numpy as np

PIXEL, HALF, REACH, PARTS, FINE, LENGTH = 1 / 32, 3**0.5, 24, 8, 3, 0.3


def covariance(slopes, products, xa, ya, xb, yb):
    total, product = 0.0, 1.0
    for s in slopes:
        a, b = (xa[:, None] + s * ya[None, :]).ravel(), (xb[:, None] + s * yb[None, :]).ravel()
        c = np.exp(-np.abs(a[:, None] - b[None, :]) / (LENGTH * (1 + s)))
        total, product = total + 0.1 * c, product * c
    return total + (0.05 * product if products and len(slopes) > 1 else 0.0)


def errors(slopes, products, noise):
    """Root mean square error of the best axis-aligned and the best filter; noise: variance of a pixel's mean."""
    x = np.arange(-REACH, REACH + 1) * PIXEL
    n = len(x) * PARTS
    y = ((np.arange(PARTS * FINE) + 0.5) / (PARTS * FINE) * 2 - 1) * HALF
    light, here = ((np.arange(64) + 0.5) / 64 * 2 - 1) * HALF, np.zeros(1)
    K = covariance(slopes, products, x, y, x, y).reshape(n, FINE, n, FINE).mean((1, 3))
    k = covariance(slopes, products, x, y, here, light).mean(1).reshape(n, FINE).mean(1)
    v = covariance(slopes, products, here, light, here, light).mean()
    best = v - k @ np.linalg.solve(K + noise * PARTS * np.eye(n), k)
    K, k = K.reshape(len(x), PARTS, len(x), PARTS).mean((1, 3)), k.reshape(len(x), PARTS).mean(1)
    return np.sqrt(v - k @ np.linalg.solve(K + noise * np.eye(len(x)), k)), np.sqrt(best)


print("slopes             rays  axis-aligned  any shear  gain along one axis")
CASES = [((1.0,), False), ((0.05,), False)] + [((0.25, far), products) for products in (False, True) for far in (0.3, 0.667)] + [((0.05, 0.2), True)]
for slopes, products in CASES:
    for rays in (4, 16):
        straight, best = errors(slopes, products, 0.2 / rays**2 / 8)  # AA_NOISE of n points, and what the filter's other axis takes the mean of
        name = (" x " if products else " + ").join(f"{s:g}" for s in slopes)
        print(f"{name:18} {rays:4}  {straight:12.5f}  {best:9.5f}  {straight / best:.2f}")
