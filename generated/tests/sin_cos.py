"""Writes sin_cos.csv: sines and cosines to twice the precision of a double, for tests/scalar.rs. Needs mpmath."""

import random

from mpmath import mp, cos, mpf, pi, sin

mp.prec = 1400
random.seed(7)


def doubles():
    yield from [0.0, 1e-300, 1e-9, 0.1, 0.5, 0.7853981633974483, 1.0]
    for k in list(range(1, 40)) + [1000, 12345, 99999, 636618]:
        # The doubles next to multiples of pi/4: where the reduction loses most.
        yield float(k * pi / 4)
    for scale in [1.0, 4.0, 100.0, 1e4, 1e6]:
        for _ in range(60):
            yield random.uniform(-scale, scale)
    yield from [1.5e6, -3e9, 1e22, 6381956970095103.0 * 2.0**797]


def parts(value):
    high = float(value)
    return f"{high!r},{float(value - mpf(high))!r}"


with open("sin_cos.csv", "w") as table:
    table.write("angle,sin,sin_rest,cos,cos_rest\n")
    for angle in doubles():
        x = mpf(angle)
        table.write(f"{angle!r},{parts(sin(x))},{parts(cos(x))}\n")
