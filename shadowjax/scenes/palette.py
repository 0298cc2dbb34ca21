"""Muted linear albedos shared by the scenes, so that their pictures look like one family."""

import numpy as np

from shadowjax._checked import checked


@checked
def from_srgb(code: str) -> np.ndarray:
    """Linear albedo (3,) of an sRGB colour written as six hexadecimal digits (IEC 61966-2-1)."""
    value = np.array([int(code[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@checked
def varied(rng: np.random.Generator, colors: np.ndarray, amount: float) -> np.ndarray:
    """Colours whose brightness is multiplied by a random factor within ±`amount`, kept in [0, 1]."""
    factors = 1.0 + amount * rng.uniform(-1.0, 1.0, size=(*np.shape(colors)[:-1], 1))
    return np.clip(colors * factors, 0.0, 1.0)


SAND = from_srgb("d9cdb8")
LIMESTONE = from_srgb("e0d6c3")
PLASTER = from_srgb("e6e1d8")
SLATE = from_srgb("6f7f8f")
TERRACOTTA = from_srgb("c4765a")
SAGE = from_srgb("93a584")
MOSS = from_srgb("6d8355")
LEAF = from_srgb("7d9b5d")
OCHRE = from_srgb("d3a856")
PLUM = from_srgb("8d6479")
TEAL = from_srgb("5f9292")
NAVY = from_srgb("4d6485")
BARK = from_srgb("8a6f56")
STEEL = from_srgb("b4bac0")
BRASS = from_srgb("cda75f")
GRAPHITE = from_srgb("62676d")
SNOW = from_srgb("eef0f0")
