"""Trapezoidal shadow maps as a choice of n': the part of the view in focus fills a chosen share of the map."""

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._types import Array, Float
from shadowjax.theory.aliasing.light_frustum import LightFrustum


@checked
def trapezoidal(frustum: LightFrustum, focus: float = 0.2, share: float = 0.8) -> Float[Array, "..."]:
    """The n' that maps the view axis point at a given depth onto the line t = share.

    A trapezoidal map differs from the other perspective warps only in how it picks n' (warping, section 4.2). With δ
    the offset of the point in focus, t(δ) = share gives n' = δ·W·(1 − share)/(share·W − δ); no warp is needed, so the
    map is uniform, where the point lies beyond that share already.

    Args:
        frustum: View and light.
        focus: Depth in focus as a share of [near, far], in (0, 1).
        share: Share of the map's rows for depths up to the focus, in (0, 1); the usual choice is the 80 % line.

    Raises:
        ValueError: If focus or share is outside (0, 1).

    Source: warping, section 4.2, on trapezoidal shadow maps; the formula is derived here.
    """
    require(0 < focus < 1, f"focus, a share of the depth range, must lie between 0 and 1; got {focus}")
    require(0 < share < 1, f"share, a share of the map's rows, must lie between 0 and 1; got {share}")
    extent = frustum.extent
    # δ of the point in focus; the uniform map where share·W ≤ δ (`ratio`).
    offset = frustum.offset(frustum.near + focus * (frustum.far - frustum.near))
    return frustum.ratio(offset * extent * (1 - share), share * extent - offset)


__all__ = ["trapezoidal"]
