"""What every optimiser answers: the best value, what it is compared with, evidence, and a technique that uses it."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax import io
from shadowjax._checked import Checked, checked
from shadowjax._checks import MAY_BE_INFINITE, require, require_int
from shadowjax._numerics import safe_divide
from shadowjax._types import Array, ArrayLike, Bool, Float
from shadowjax.partitions.cascades import Cascades
from shadowjax.rays.casters import default_caster
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.warps.fit import PerspectiveFit

Value = TypeVar("Value")
Evidence = TypeVar("Evidence")

# What a gain over nothing counts as: the objective is 0 and that of the baseline is not.
LARGEST_GAIN = 1e12
MARGIN = 1e-5  # of a map's size, beyond what is seen on each side


class SolutionKind(NamedTuple):
    """What the solutions of one optimiser have in common.

    Attributes:
        json: Key in JSON → attribute, in dots from the solution on.
        rival: Name of the baseline that the gain counts against.
        technique: Makes the technique of a solution for one view, from a resolution and attributes of `ShadowMapping`;
            None where the value is no number of a technique.
    """

    json: tuple[tuple[str, str], ...]
    rival: str = "published"
    technique: Callable[[Any, int, dict[str, Any]], ShadowMapping] | None = None


class Solution(Checked, Generic[Value, Evidence]):
    """The answer of an optimiser for one view or many; a pytree, under `jit`, `vmap` and `grad`.

    Attributes:
        value: What was asked for; a table in the documentation says type, shape and unit for each optimiser.
        objective_value: The objective there; it has the shape of the views.
        baselines: Name → objective of another choice, such as the published one.
        certificate: Evidence that the value is optimal, and what was measured with it.
        result: How the search ended, `optimistix.RESULTS`; `text` says it in words.
        problem: What the value was found for, which `technique` freezes.
        kind: What all solutions of the optimiser have in common.
    """

    value: Value
    objective_value: Float[Array, "*views"]
    baselines: dict[str, Float[Array, "*views"]]
    certificate: Evidence
    result: Any
    problem: Any = None
    kind: SolutionKind = eqx.field(static=True, default=SolutionKind(()))

    @property
    def gain(self) -> Float[Array, "*views"]:
        """Objective of the baseline over that found: of "published", or of what the optimiser names in its place."""
        before, found = self.baselines[self.kind.rival], self.objective_value
        return jnp.where(found > 0, safe_divide(before, found), jnp.where(before > 0, LARGEST_GAIN, 1.0))

    @property
    def converged(self) -> Bool[Array, "*views"]:
        """Whether the search found what it was to find."""
        code, good = (jnp.asarray(jax.tree.leaves(end)[0]) for end in (self.result, optx.RESULTS.successful))
        return code == good

    @property
    def text(self) -> str:
        """How the search ended, in words; of many views, how many ended in each way."""
        codes, first, counts = np.unique(jax.tree.leaves(self.result)[0], return_index=True, return_counts=True)
        flat = jax.tree.map(lambda x: jnp.reshape(x, -1), self.result)
        words = [
            optx.RESULTS[jax.tree.map(lambda x, at=at: x[at], flat)].split("\n")[0] or "successful" for at in first
        ]
        if len(codes) == 1:
            return words[0]
        return "; ".join(f"{count} of {counts.sum()}: {said}" for count, said in zip(counts, words, strict=True))

    def __getitem__(self, index: Any) -> "Solution[Value, Evidence]":
        """The solution of one view, or of some: every array indexed along the axes of the views.

        Raises:
            IndexError: If there is no such view.
        """
        np.empty(self.objective_value.shape, bool)[index]  # arrays of JAX do not say so
        return jax.tree.map(lambda x: x[index], self)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings, as `shadowjax optimize` writes them."""
        return {key: _plain(_reached(self, path)) for key, path in self.kind.json}

    def to_json(self, path: str | Path) -> Path:
        """Write `to_dict` to a file, and return its path.

        Raises:
            ValueError: If the file cannot be written.
        """
        return io.write_json(path, self.to_dict())

    def technique(self, resolution: int = 1024, **options: Any) -> ShadowMapping:
        """The shadow map with this value: near, far and cuts are those it was found for, whatever it is built for.

        Args:
            resolution: Texels along each side of every map, ≥ 1.
            options: Attributes of `ShadowMapping`, such as filter, bias and caster.

        Raises:
            ValueError: If this holds many views, or the value is no number of a technique.
        """
        require_int(resolution, "resolution", 1)
        require(self.kind.technique is not None, "this value is no number of a technique; take it from .value")
        shape = self.objective_value.shape
        require(shape == (), f"one technique is for one view, and this is for {shape} of them; take [i] of it first")
        assert self.kind.technique is not None
        return self.kind.technique(self, resolution, options)


def _reached(solution: Any, path: str) -> Any:
    found = solution
    for name in path.split("."):
        found = found[name] if isinstance(found, Mapping) else getattr(found, name)
    return found


def _plain(value: Any) -> Any:
    """JSON of arrays, modules, dataclasses, mappings and sequences."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return value


@checked
def with_slices(
    cuts: ArrayLike,
    near_distances: Annotated[ArrayLike, MAY_BE_INFINITE],
    resolution: int,
    options: dict[str, Any],
) -> ShadowMapping:
    """Maps between given planes with given n', hardly larger than what is seen, so that errors are those predicted.

    Args:
        cuts: k + 1 rising depths, world units.
        near_distances: n' of every slice, world units.
        resolution: Texels along each side of every map.
        options: Attributes of `ShadowMapping`; a filter that reads beyond its texel gets maps larger by that.
    """
    beyond = max(0.0, options["filter"].reach - 0.5) / resolution if "filter" in options else 0.0
    warp = PerspectiveFit(margin=min(max(MARGIN, beyond), 0.1))
    return with_maps(resolution, options, partition=Cascades.at(cuts, near_distances, warp=warp))


@checked
def with_maps(resolution: int, options: dict[str, Any], **found: Any) -> ShadowMapping:
    """Shadow maps with what was found, unless the options say otherwise."""
    return ShadowMapping(**{"caster": default_caster(), **found, "resolution": resolution, **options})


@checked
def ended(good: Bool[Array, "*views"], otherwise: Any = optx.RESULTS.nonlinear_divergence) -> Any:
    """`RESULTS.successful` where a search found what it was to find, else another end."""
    return optx.RESULTS.where(good, optx.RESULTS.successful, otherwise)


__all__ = ["Solution", "SolutionKind", "ended", "with_maps", "with_slices"]
