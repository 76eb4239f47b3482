"""Writes exp.csv: exponentials to twice the precision of a double, for tests/scalar.rs. Needs mpmath."""

import random

from mpmath import exp, log, mp, mpf

mp.prec = 300
random.seed(11)


def doubles():
    yield from [0.0, -0.0, 1e-300, -1e-300, 1e-17, -1e-17, 1e-9, 0.1, 0.5, 1.0, -1.0, 2.0]
    for k in [1, 2, 3, 7, 40, 500, 1000, 1021, 1023]:
        # The doubles next to odd multiples of ln(2)/2: where the reduction leaves most.
        yield float((2 * k - 1) * log(mpf(2)) / 2) if k < 1000 else float((k - mpf(0.5)) * log(mpf(2)))
        yield -float((k - mpf(0.5)) * log(mpf(2)))
    for scale in [0.3, 1.0, 10.0, 100.0, 700.0]:
        for _ in range(80):
            yield random.uniform(-scale, scale)
    # Results that are the largest, and subnormal ones.
    yield from [709.0, 709.78, 709.782712893384, -708.0, -708.3964185322641, -709.5, -720.25, -740.0, -744.0, -745.0]


def parts(value):
    high = float(value)
    return f"{high!r},{float(value - mpf(high))!r}"


with open("exp.csv", "w") as table:
    table.write("x,exp,exp_rest\n")
    for x in doubles():
        table.write(f"{x!r},{parts(exp(mpf(x)))}\n")
