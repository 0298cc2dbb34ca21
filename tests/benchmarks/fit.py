"""A law of time: milliseconds ≈ a · triangles + b · pixels + c · √(triangles · pixels), and how far it is off."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.optimize import nnls


def law_of_time(triangles: Iterable[float], pixels: Iterable[float], milliseconds: Iterable[float]) -> dict[str, Any]:
    """Fit the three coefficients, none negative, with equal weight on every *relative* error.

    Args:
        triangles: Of each measurement.
        pixels: Of each measurement.
        milliseconds: Of each measurement, > 0.

    Returns:
        Nanoseconds a triangle, a pixel and a √(triangle · pixel), the median and the largest relative error, and the
        number of measurements.
    """
    count, area, time = (np.asarray(list(x), np.float64) for x in (triangles, pixels, milliseconds))
    terms = np.stack([count, area, np.sqrt(count * area)], axis=1)
    coefficients, _ = nnls(terms / time[:, None], np.ones(len(time)))
    error = np.abs(terms @ coefficients / time - 1)
    names = ("ns_per_triangle", "ns_per_pixel", "ns_per_root_triangle_pixel")
    return {
        **{name: float(1e6 * value) for name, value in zip(names, coefficients, strict=True)},
        "median_relative_error": float(np.median(error)),
        "largest_relative_error": float(error.max()),
        "measurements": len(time),
    }


def laws(records: Iterable[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The law of every contestant with four depth maps or more."""
    points: dict[str, list[tuple[float, float, float]]] = {}
    for record in records:
        if record["case"] == "depth":
            for name, entry in record["contestants"].items():
                size = record["triangles"], record["rows"] * record["columns"], entry["median_ms"]
                points.setdefault(name, []).append(size)
    return {name: law_of_time(*zip(*each, strict=True)) for name, each in points.items() if len(each) >= 4}
