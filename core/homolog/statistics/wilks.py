"""Wilks' lambda, its F by Rao, and Hotelling's T²."""

import numpy as np
from scipy import stats

from homolog.arrays import FloatArray, IntArray

__all__ = ["hotelling", "rao_f", "wilks_p"]



