"""Silverbox, an electronic Duffing oscillator: simulation errors on the official test parts, without and with the cubic spring.

    python docs/proof/silverbox.py PATH/SNLS80mV.csv
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynid
import numpy
from rows import Row, digest, options, write

RATE_HZ = 610.35
# The split of the package nonlinear_benchmarks 1.0.1, in rows of SNLS80mV; the first 50 samples of a test start a simulation and do not count.
TRAIN = (40650, 105712)
TESTS = {"multisine": (105712, 127400), "arrow": (100, 40575), "arrow, amplitudes of the training only": (100, 32100)}
START = 50
