"""The registries of filters, and of policies for the extra depths of a texel, by name with their default settings."""

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._registry import Entry, Registry
from shadowjax.filters.base import Filter
from shadowjax.filters.brabec_seidel import PropagatedNeighbours, Supersampled
from shadowjax.filters.convolution import Convolution, MeanDepthConvolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.hard import Hard
from shadowjax.filters.hierarchical_minimum import HierarchicalMinimum
from shadowjax.filters.moment import Moments
from shadowjax.filters.multi_depth import DepthPolicy, MultiDepth, Neighbourhood, Ring
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.filters.pcss import ContactHardening
from shadowjax.filters.variance import Variance

FILTERS: Registry[Filter] = Registry("filter", {
    "hard": Entry(Hard, "one depth test"),
    "pcf-KxK": Entry(PercentageCloser, "mean of K × K depth tests", (2, 3, 4)),
    "pcf-bilinear": Entry(lambda: BilinearPercentageCloser(1), "four tests with bilinear weights"),
    "pcf-bilinear-KxK": Entry(BilinearPercentageCloser, "K × K bilinear taps", (3,)),
    "pcss": Entry(ContactHardening, "PCF as wide as the penumbra"),
    "brabec-seidel": Entry(Supersampled, "four rays a texel, for soft edges"),
    "vsm": Entry(lambda: Variance(bleed_low=0.2), "variance: two moments"),
    "esm": Entry(Exponential, "exponential"),
    "esm-threshold": Entry(lambda: Exponential(fallback="threshold"), "exponential, PCF where it fails"),
    "esm-z-max": Entry(lambda: Exponential(fallback="z-max"), "exponential, PCF by the largest depth"),
    "evsm2": Entry(lambda: ExponentialVariance(negative=None), "exponential variance: two moments"),
    "evsm4": Entry(ExponentialVariance, "exponential variance: four moments"),
    "msm-hamburger": Entry(Moments, "four moments, for any depths"),
    "msm-hausdorff": Entry(lambda: Moments(problem="hausdorff"), "four moments, for depths in [0, 1]"),
    "csm": Entry(Convolution, "convolution: Fourier series of the test"),
    "xcsm": Entry(MeanDepthConvolution, "convolution, in the mean depth"),
})  # fmt: skip

DEPTH_POLICIES: Registry[DepthPolicy] = Registry("depths", {
    "brabec-seidel-propagated": Entry(PropagatedNeighbours, "depths of neighbours (Brabec and Seidel)"),
    "hyper-z": Entry(HierarchicalMinimum, "least depths of blocks: a failure to study"),
    "2sm-max": Entry(lambda: Neighbourhood("max"), "the depth, and the largest of 3 × 3"),
    "2sm-min": Entry(lambda: Neighbourhood("min"), "the depth, and the least of 3 × 3"),
    "3sm": Entry(lambda: Neighbourhood("min-max"), "the depth, the largest and the least of 3 × 3"),
    "Nsm": Entry(Ring, "the depth and samples round it, N in all", (4, 5), 9, 4),
})  # fmt: skip


@checked
def over_depths(policy: DepthPolicy, filter_: Filter) -> Filter:
    """A filter that counts depth tests, reading several depths a texel in place of one.

    Raises:
        ValueError: If it does not count tests, or its taps are weighted.
    """
    plain = isinstance(filter_, Hard) or (isinstance(filter_, PercentageCloser) and filter_.width_world is None)
    require(
        plain,
        f"several depths a texel are counted test by test, which {type(filter_).__name__} does not do: take hard or "
        "pcf-KxK with them",
    )
    return MultiDepth(policy, filter_.kernel_size if isinstance(filter_, PercentageCloser) else 1)


__all__ = ["DEPTH_POLICIES", "FILTERS", "over_depths"]
